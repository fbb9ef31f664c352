#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace volalign::formats_internal {

/// Scans a text once, from left to right, without looking back or recursion. A call that does not
/// find its text reports that and takes nothing.
class TextScanner {
 public:
  explicit TextScanner(std::string_view text) : text_(text) {}

  bool Take(std::string_view word) {
    if (text_.substr(at_, word.size()) != word) return false;
    at_ += word.size();
    return true;
  }
  /// Takes one of `letters`; 0 if none of them is next.
  char TakeOneOf(std::string_view letters) {
    if (at_ == text_.size() || letters.find(text_[at_]) == std::string_view::npos) return 0;
    return text_[at_++];
  }
  /// True if there was one.
  bool SkipBlanks() { return !TakeWhile(kBlanks, text_.size()).empty(); }
  /// Takes the text before the next blank.
  std::string_view TakeWord() {
    const std::string_view word = rest().substr(0, rest().find_first_of(kBlanks));
    at_ += word.size();
    return word;
  }
  /// Takes at most `most` digits, as a number below 10^most; -1 if there is none.
  int TakeNumber(std::size_t most) {
    const std::string digits(TakeWhile("0123456789", most));
    return digits.empty() ? -1 : std::stoi(digits);
  }
  /// Takes the text before the next `end`, and `end` too.
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
