#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace volalign {

/// The words for the values of an enum, each value once. An enum that appears in files has a
/// function `WordsOf(Enum)` beside it, which returns its Words. This gives ToString and AllOf, by
/// which configurations, JSON, options and messages read and write it.
template <class Enum, std::size_t N>
using Words = std::array<std::pair<const char*, Enum>, N>;

template <class Enum, class = decltype(WordsOf(Enum()))>
const char* ToString(Enum value) {
  const auto words = WordsOf(value);
  return std::find_if(words.begin(), words.end(), [&](const auto& w) { return w.second == value; })
      ->first;
}

template <class Enum, class = decltype(WordsOf(Enum()))>
std::vector<Enum> AllOf(Enum any) {
  std::vector<Enum> values;
  for (const auto& [word, value] : WordsOf(any)) values.push_back(value);
  return values;
}

/// The word of each value, in the order of AllOf.
template <class Enum>
std::vector<std::string> WordsOfAll() {
  std::vector<std::string> words;
  for (const Enum value : AllOf(Enum())) words.emplace_back(ToString(value));
  return words;
}

/// Sets `value` to the meaning of the word; false if the word has none.
template <class Enum>
bool FromWord(const std::string& word, Enum* value) {
  for (const Enum candidate : AllOf(Enum())) {
    if (ToString(candidate) != word) continue;
    *value = candidate;
    return true;
  }
  return false;
}

}  // namespace volalign
