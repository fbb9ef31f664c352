#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "core/config.h"

namespace volalign {

/// Describes a key whose values are words, each of which stands for a value of an enum:
/// `words` is an array of pairs (word, value) that has every value of the enum once.
template <class Archive, class Enum, std::size_t N>
void DescribeWord(Archive& ar, const std::string& name, Enum& value,
                  const std::array<std::pair<const char*, Enum>, N>& words, const char* doc) {
  std::vector<std::string> allowed;
  std::string word;
  for (const auto& [text, meaning] : words) {
    allowed.emplace_back(text);
    if (meaning == value) word = text;
  }
  ar(name, word, doc, OneOf(allowed));
  for (const auto& [text, meaning] : words) {
    if (word == text) value = meaning;
  }
}

}  // namespace volalign
