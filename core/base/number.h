#pragma once

#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>
#include <system_error>

namespace volalign {

/// The finite number that the whole text is, or nothing. The decimal separator is a point in any
/// locale.
inline std::optional<double> NumberOf(std::string_view text) {
  // from_chars takes no plus. "+-1" is no number.
  if (text.substr(0, 1) == "+" && text.substr(0, 2) != "+-") text.remove_prefix(1);
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  const bool whole = error == std::errc() && rest == end && !text.empty();
  return whole && std::isfinite(value) ? std::optional(value) : std::nullopt;
}

}  // namespace volalign
