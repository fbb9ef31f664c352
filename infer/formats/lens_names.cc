#include "infer/formats/lens_names.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign::formats_internal {

namespace {

/// Coefficients in OpenCV's order: more than eight only if the rest is 0.
std::vector<double> Distortion(std::vector<double> numbers, const std::string& name) {
  if (numbers.size() > 8) {
    if (std::any_of(numbers.begin() + 8, numbers.end(), [](double x) { return x != 0; })) {
      throw DataError(fmt::format(
          "{}: {} distortion coefficients, of which those after the eighth (thin prism, tilt) are "
          "not 0; calibrate with at most eight",
          name, numbers.size()));
    }
    numbers.resize(8);
  }
  return numbers;
}

}  // namespace

std::vector<double> NamedLens(const std::string& model, const std::vector<double>& numbers,
                              const std::string& name) {
  const bool is_zero = std::all_of(numbers.begin(), numbers.end(), [](double x) { return x == 0; });
  std::string word = Lower(model);
  std::replace_if(
      word.begin(), word.end(), [](char c) { return c == '-' || c == ' '; }, '_');
  for (const char* known : {"plumb_bob", "rational_polynomial", "brown_conrady",
                            "distortion.brown_conrady", "rs2_distortion_brown_conrady"}) {
    if (word == known || word.empty()) return Distortion(numbers, name);
  }
  // Without coefficients every model is a rectified image; RealSense prints five zeros.
  if (is_zero) return std::vector<double>(numbers.empty() ? 0 : 5, 0.0);
  throw DataError(fmt::format(
      "{}: the lens model \"{}\" is not OpenCV's (plumb_bob, rational_polynomial, Brown Conrady); "
      "rectify the frames, or calibrate with one of these",
      name, Shortened(model)));
}

}  // namespace volalign::formats_internal
