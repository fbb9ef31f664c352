#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "core/config/config.h"

namespace volalign {

/// The words that stand for the values of an enum, each value once.
template <class Enum, std::size_t N>
using Words = std::array<std::pair<const char*, Enum>, N>;

template <class Enum, std::size_t N>
const char* WordOf(const Words<Enum, N>& words, Enum value) {
  return std::find_if(words.begin(), words.end(), [&](const auto& w) { return w.second == value; })
      ->first;
}

template <class Enum, std::size_t N>
std::vector<Enum> ValuesOf(const Words<Enum, N>& words) {
  std::vector<Enum> values;
  for (const auto& [word, value] : words) values.push_back(value);
  return values;
}

/// Describes a key whose values are words.
template <class Archive, class Enum, std::size_t N, class... Constraints>
void DescribeWord(Archive& ar, const std::string& name, Enum& value, const Words<Enum, N>& words,
                  const char* doc, Constraints... constraints) {
  std::vector<std::string> allowed;
  for (const auto& [text, meaning] : words) allowed.emplace_back(text);
  std::string word = WordOf(words, value);
  ar(name, word, doc, OneOf(allowed), constraints...);
  for (const auto& [text, meaning] : words) {
    if (word == text) value = meaning;
  }
}

}  // namespace volalign
