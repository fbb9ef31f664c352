#include "infer/formats/printed_intrinsics.h"

#include <fmt/format.h>

#include <map>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "infer/formats/lens_names.h"
#include "infer/formats/text_scanner.h"

namespace volalign::formats_internal {

namespace {

constexpr std::size_t kMostSizeDigits = 5;  // of a width or height
constexpr std::size_t kLongestPrint = 1000;

/// The numbers up to the first other word.
std::vector<double> NumbersOfText(const std::string& text) {
  std::vector<double> numbers;
  TextScanner scanner(text);
  for (scanner.SkipBlanks(); !scanner.rest().empty(); scanner.SkipBlanks()) {
    const std::optional<double> number = NumberOf(scanner.TakeWord());
    if (!number) break;
    numbers.push_back(*number);
  }
  return numbers;
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  for (const std::string& line : Split(block, '\n')) {
    TextScanner scanner(line);
    scanner.SkipBlanks();
    if (!scanner.Take(key) || !scanner.Take(":")) continue;
    scanner.SkipBlanks();
    return std::string(scanner.rest());
  }
  throw DataError(fmt::format("{}: {} is missing", name, key));
}

/// "640x480  p[318.5 240.9]  f[383.3 384.4]  Brown Conrady [0.1 0 0 0.2 0]", in brackets; the first
/// bracket is taken already.
struct Printed {
  int width = 0, height = 0;
  std::string_view centre, focal, model, distortion;
};
std::optional<Printed> TakePrinted(TextScanner scanner) {
  Printed printed;
  scanner.SkipBlanks();
  printed.width = scanner.TakeNumber(kMostSizeDigits);
  if (printed.width < 0 || !scanner.Take("x")) return std::nullopt;
  printed.height = scanner.TakeNumber(kMostSizeDigits);
  if (printed.height < 0 || !scanner.SkipBlanks() || !scanner.Take("p[") ||
      !scanner.TakeUntil(']', &printed.centre) || !scanner.SkipBlanks() || !scanner.Take("f[") ||
      !scanner.TakeUntil(']', &printed.focal) || !scanner.TakeUntil('[', &printed.model) ||
      !scanner.TakeUntil(']', &printed.distortion))
    return std::nullopt;
  scanner.SkipBlanks();
  if (!scanner.Take("]")) return std::nullopt;
  return printed;
}

std::string WithoutBlanksAround(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(TextScanner::kBlanks);
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(TextScanner::kBlanks) + 1 - begin));
}

}  // namespace

std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name) {
  for (std::size_t at = text.find('['); at != std::string::npos; at = text.find('[', at + 1)) {
    // Only a part of the text, so that many open brackets do not each search all of it.
    const std::optional<Printed> printed =
        TakePrinted(TextScanner(std::string_view(text).substr(at + 1, kLongestPrint)));
    if (!printed) continue;
    const std::vector<double> c = NumbersOfText(std::string(printed->centre)),
                              f = NumbersOfText(std::string(printed->focal));
    if (c.size() != 2 || f.size() != 2)
      throw DataError(name + ": p[...] and f[...] have two numbers each");
    return Intrinsics{printed->width,
                      printed->height,
                      f[0],
                      f[1],
                      c[0],
                      c[1],
                      NamedLens(WithoutBlanksAround(printed->model),
                                NumbersOfText(std::string(printed->distortion)), name)};
  }
  return std::nullopt;
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
    const std::string model = WithoutBlanksAround(After(block, "Distortion", name));
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

namespace {

/// "< fx=504.5 fy=504.5 >" behind the word: the values by their keys.
std::map<std::string, double> ValuesBehind(const std::string& text, const std::string& word,
                                           const std::string& name) {
  const std::size_t at = text.find(word), open = text.find('<', at), close = text.find('>', at);
  if (at == std::string::npos || open == std::string::npos || close < open)
    throw DataError(fmt::format("{}: {} is missing", name, word));
  std::string part = text.substr(open + 1, close - open - 1);
  for (char& c : part) {
    if (TextScanner::kBlanks.find(c) != std::string_view::npos || c == ',') c = ' ';
  }
  std::map<std::string, double> values;
  for (const std::string& pair : Split(part, ' ')) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos) continue;
    const std::vector<double> numbers = NumbersOfText(pair.substr(equals + 1));
    if (numbers.size() == 1) values[pair.substr(0, equals)] = numbers[0];
  }
  return values;
}

}  // namespace

std::optional<Intrinsics> FromPyorbbec(const std::string& text, const std::string& name) {
  if (text.find("OBCameraParam") == std::string::npos) return std::nullopt;
  const auto camera = ValuesBehind(text, "depth_intrinsic", name);
  const auto lens = ValuesBehind(text, "depth_distortion", name);
  const auto value = [&](const std::map<std::string, double>& of, const char* key) {
    const auto found = of.find(key);
    if (found == of.end()) throw DataError(fmt::format("{}: {} has no number", name, key));
    return found->second;
  };
  const auto pixels = [&](const char* key) {
    const double number = value(camera, key);
    if (!(number >= 1 && number <= 1e5))
      throw DataError(fmt::format("{}: {} = {} is no number of pixels", name, key, number));
    return static_cast<int>(number);
  };
  Intrinsics intrinsics{pixels("width"),
                        pixels("height"),
                        value(camera, "fx"),
                        value(camera, "fy"),
                        value(camera, "cx"),
                        value(camera, "cy"),
                        {}};
  for (const char* key : {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"})
    intrinsics.distortion.push_back(value(lens, key));
  return intrinsics;
}

}  // namespace volalign::formats_internal
