#include "infer/formats/printed_intrinsics.h"

#include <fmt/format.h>

#include <regex>
#include <sstream>
#include <vector>

#include "core/base/error.h"
#include "infer/formats/lens_names.h"

namespace volalign::formats_internal {

namespace {

std::vector<double> NumbersOfText(const std::string& text) {
  std::istringstream stream(text);
  std::vector<double> numbers;
  for (double x; stream >> x;) numbers.push_back(x);
  return numbers;
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  std::smatch m;
  if (!std::regex_search(block, m, std::regex("(?:^|\n)\\s*" + key + ":\\s*([^\n]*)")))
    throw DataError(fmt::format("{}: {} is missing", name, key));
  return m[1];
}

}  // namespace

std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name) {
  static const std::regex pattern(
      R"(\[\s*(\d{1,5})x(\d{1,5})\s+p\[(\S+) (\S+)\]\s+f\[(\S+) (\S+)\]\s+([\w ]+?)\s*\[([^\]]*)\]\s*\])");
  std::smatch m;
  if (!std::regex_search(text, m, pattern)) return std::nullopt;
  const std::vector<double> k =
      NumbersOfText(m[3].str() + " " + m[4].str() + " " + m[5].str() + " " + m[6].str());
  if (k.size() != 4) throw DataError(name + ": p[...] and f[...] have two numbers each");
  return Intrinsics{std::stoi(m[1]),
                    std::stoi(m[2]),
                    k[2],
                    k[3],
                    k[0],
                    k[1],
                    NamedLens(m[7], NumbersOfText(m[8]), name)};
}

std::optional<Intrinsics> FromRsEnumerate(const std::string& text, const std::string& name,
                                          const FrameSize& frame) {
  const std::string title = "Intrinsic of \"Depth\"";
  std::size_t at = text.find(title);
  if (at == std::string::npos) return std::nullopt;
  for (; at != std::string::npos; at = text.find(title, at + 1)) {
    const std::string block = text.substr(at, text.find("Intrinsic of", at + 1) - at);
    const auto number = [&](const char* key) {
      const std::vector<double> numbers = NumbersOfText(After(block, key, name));
      if (numbers.empty()) throw DataError(fmt::format("{}: {} has no number", name, key));
      return numbers[0];
    };
    if (number("Width") != frame.width || number("Height") != frame.height) continue;
    std::string model = After(block, "Distortion", name);
    model.erase(model.find_last_not_of(" \t\r") + 1);
    return Intrinsics{frame.width,
                      frame.height,
                      number("Fx"),
                      number("Fy"),
                      number("PPX"),
                      number("PPY"),
                      NamedLens(model, NumbersOfText(After(block, "Coeffs", name)), name)};
  }
  throw DataError(
      fmt::format("{}: no intrinsics of a depth stream of {}x{}", name, frame.width, frame.height));
}

}  // namespace volalign::formats_internal
