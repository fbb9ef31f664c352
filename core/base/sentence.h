#pragma once

#include <exception>
#include <string>

namespace volalign {

/// A sentence for an exception of the system or a library: one line, as a MessageLine, with the
/// file or the limit if there is one.
std::string SentenceOf(const std::exception& error);

}  // namespace volalign
