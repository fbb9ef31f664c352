#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace volalign::formats_internal {

/// Goes through a text once, from left to right: no call looks back, or calls itself, whatever the
/// text. A call that does not find what it takes says so and takes nothing.
class TextScanner {
 public:
  explicit TextScanner(std::string_view text) : text_(text) {}

  bool Take(std::string_view word) {
    if (text_.substr(at_, word.size()) != word) return false;
    at_ += word.size();
    return true;
  }
  /// One of `letters`; 0 where none of them is next.
  char TakeOneOf(std::string_view letters) {
    if (at_ == text_.size() || letters.find(text_[at_]) == std::string_view::npos) return 0;
    return text_[at_++];
  }
  /// Says whether there was one.
  bool SkipBlanks() { return !TakeWhile(kBlanks, text_.size()).empty(); }
  /// What stands before the next blank.
  std::string_view TakeWord() {
    const std::string_view word = rest().substr(0, rest().find_first_of(kBlanks));
    at_ += word.size();
    return word;
  }
  /// At most `most` digits, as a number below 10^most; -1 where there is none.
  int TakeNumber(std::size_t most) {
    const std::string digits(TakeWhile("0123456789", most));
    return digits.empty() ? -1 : std::stoi(digits);
  }
  /// What stands before the next `end`, which is taken too.
  bool TakeUntil(char end, std::string_view* taken) {
    const std::size_t found = text_.find(end, at_);
    if (found == std::string_view::npos) return false;
    *taken = text_.substr(at_, found - at_);
    at_ = found + 1;
    return true;
  }

  std::string_view rest() const { return text_.substr(at_); }

  static constexpr std::string_view kBlanks = " \t\r\n\v\f";

 private:
  std::string_view TakeWhile(std::string_view letters, std::size_t most) {
    const std::size_t begin = at_;
    while (at_ < text_.size() && at_ - begin < most &&
           letters.find(text_[at_]) != std::string_view::npos)
      ++at_;
    return text_.substr(begin, at_ - begin);
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace volalign::formats_internal
