#include "core/base/sentence.h"

#include <fmt/format.h>

#include <filesystem>
#include <new>
#include <system_error>

#include "core/base/shown_path.h"
#include "core/base/text.h"

namespace volalign {

std::string SentenceOf(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return "there is not enough memory for this";
  if (const auto* of_file = dynamic_cast<const std::filesystem::filesystem_error*>(&error))
    return fmt::format("{}: {}", ShownPath(of_file->path1()), of_file->code().message());
  const auto* const of_system = dynamic_cast<const std::system_error*>(&error);
  if (of_system && of_system->code() == std::errc::resource_unavailable_try_again) {
    return "the system gives no more threads or processes (ulimit -u); end some of them, or ask "
           "for "
           "fewer threads";
  }
  return MessageLine(FirstLine(error.what()));
}

}  // namespace volalign
