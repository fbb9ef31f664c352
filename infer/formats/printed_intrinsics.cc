#include "infer/formats/printed_intrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <locale>
#include <map>
#include <sstream>
#include <vector>

#include "core/base/error.h"
#include "core/base/number.h"
#include "core/base/text.h"
#include "infer/formats/lens_names.h"

namespace volalign::formats_internal {

namespace {

constexpr std::size_t kLongestPrint = 1000;
constexpr char kBlanks[] = " \t\r\n\v\f";

/// The numbers up to the first other word.
std::vector<double> NumbersOfText(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::optional<double> number = NumberOf(word);
    if (!number) break;
    numbers.push_back(*number);
  }
  return numbers;
}

std::string WithoutBlanksAround(const std::string& text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

/// The text after `key` up to the end of its line.
std::string After(const std::string& block, const std::string& key, const std::string& name) {
  for (const std::string& line : Split(block, '\n')) {
    const std::string text = WithoutBlanksAround(line);
    if (text.rfind(key + ":", 0) == 0) return WithoutBlanksAround(text.substr(key.size() + 1));
  }
  throw DataError(fmt::format("{}: {} is missing", name, key));
}

/// "640x480  p[318.5 240.9]  f[383.3 384.4]  Brown Conrady [0.1 0 0 0.2 0]", in brackets; the first
/// bracket is taken already.
struct Printed {
  int width = 0, height = 0;
  std::string centre, focal, model, distortion;
};
std::optional<Printed> TakePrinted(const std::string& text) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  Printed printed;
  char x = 0, end = 0;
  std::string p, f;
  const auto until = [&](char mark, std::string* part) {
    return static_cast<bool>(std::getline(stream, *part, mark));
  };
  const bool whole = stream >> printed.width >> x >> printed.height && until('[', &p) &&
                     until(']', &printed.centre) && until('[', &f) && until(']', &printed.focal) &&
                     until('[', &printed.model) && until(']', &printed.distortion) && stream >> end;
  if (!whole || x != 'x' || WithoutBlanksAround(p) != "p" || WithoutBlanksAround(f) != "f" ||
      end != ']')
    return std::nullopt;
  return printed;
}

}  // namespace

std::optional<Intrinsics> FromPyrealsense(const std::string& text, const std::string& name) {
  for (std::size_t at = text.find('['); at != std::string::npos; at = text.find('[', at + 1)) {
    // Only a part of the text, so that many open brackets do not each search all of it.
    const std::optional<Printed> printed = TakePrinted(text.substr(at + 1, kLongestPrint));
    if (!printed) continue;
    const std::vector<double> c = NumbersOfText(printed->centre), f = NumbersOfText(printed->focal);
    if (c.size() != 2 || f.size() != 2)
      throw DataError(name + ": p[...] and f[...] have two numbers each");
    return Intrinsics{
        printed->width,
        printed->height,
        f[0],
        f[1],
        c[0],
        c[1],
        NamedLens(WithoutBlanksAround(printed->model), NumbersOfText(printed->distortion), name)};
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
    const std::string model = After(block, "Distortion", name);
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
  std::replace(part.begin(), part.end(), ',', ' ');
  std::map<std::string, double> values;
  std::istringstream words(part);
  for (std::string pair; words >> pair;) {
    const std::size_t equals = std::min(pair.find('='), pair.size() - 1);
    if (const std::optional<double> number = NumberOf(pair.substr(equals + 1)))
      values[pair.substr(0, equals)] = *number;
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
