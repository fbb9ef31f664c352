#pragma once

#include <exception>
#include <string>

namespace volalign {

/// What an exception says that is not volalign's, but of the system or of a library: one line, as a
/// MessageLine, that names the file or the limit where there is one.
std::string SentenceOf(const std::exception& error);

}  // namespace volalign
