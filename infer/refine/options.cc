#include "infer/refine/options.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"

namespace volalign {

EstimateSet ParseEstimate(const std::string& text) {
  EstimateSet set;
  if (text == "none") return set;
  if (text == "auto") return {true, true, true, true, true};
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(',', begin), text.size());
    std::string word = text.substr(begin, end - begin);
    word.erase(std::remove(word.begin(), word.end(), ' '), word.end());
    if (word == "boxes") {
      set.boxes = true;
    } else if (word == "size") {
      set.size = true;
    } else if (word == "depth_gain") {
      set.depth_gain = true;
    } else if (word == "depth_offset") {
      set.depth_offset = true;
    } else if (word == "lens") {
      set.lens = true;
    } else {
      throw ConfigError(
          fmt::format("refine.estimate = \"{}\": \"{}\" is none of boxes, size, depth_gain, "
                      "depth_offset, lens; "
                      "or give auto or none alone",
                      text, word));
    }
    begin = end + 1;
  }
  return set;
}

}  // namespace volalign
