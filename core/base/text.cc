#include "core/base/text.h"

#include <fmt/format.h>

#include <cctype>
#include <cstdlib>
#include <sstream>

#include "core/base/error.h"

namespace volalign {
namespace {

/// With apostrophes before it, too, which CsvQuoted and CsvText would else mix up with their own.
bool IsFormula(const std::string& text) {
  const std::size_t begin = text.find_first_not_of('\'');
  if (begin == std::string::npos || std::string("=+-@").find(text[begin]) == std::string::npos) {
    return false;
  }
  const std::string cell = text.substr(begin);
  char* end = nullptr;
  std::strtod(cell.c_str(), &end);
  return begin > 0 || end != cell.c_str() + cell.size();
}

}  // namespace

std::string Lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

std::vector<std::string> Split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == separator) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

std::string Indented(const std::string& text, const std::string& indent) {
  std::string indented;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    indented += (line.empty() ? "" : indent + line) + "\n";
  return indented;
}

bool HasControlCharacters(const std::string& text) { return Printable(text) != text; }

std::string Printable(const std::string& text) {
  std::string printable;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const auto next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : '\0');
    if (byte < 0x20 || byte == 0x7f) {
      printable += fmt::format("\\x{:02x}", byte);
    } else if (byte == 0xc2 && next >= 0x80 && next < 0xa0) {  // U+0080 to U+009F in UTF-8
      printable += fmt::format("\\x{:02x}", next);
      ++i;
    } else {
      printable += text[i];
    }
  }
  return printable;
}

std::string Shortened(const std::string& text, std::size_t most) {
  if (text.size() <= most) return Printable(text);
  // Not within a character of UTF-8.
  while (most > 0 && (static_cast<unsigned char>(text[most]) & 0xc0) == 0x80) --most;
  return Printable(text.substr(0, most)) + "...";
}

void RequirePlainName(const std::string& name, const std::string& place) {
  if (name.size() <= kMostNameBytes && !HasControlCharacters(name)) return;
  throw DataError(fmt::format(
      "{}: the name \"{}\" has control characters or more than {} bytes; use a plain word", place,
      Shortened(name, kMostNameBytes), kMostNameBytes));
}

std::string CsvQuoted(const std::string& text) {
  std::string quoted = IsFormula(text) ? "\"'" : "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string CsvText(const std::string& field) {
  return field.rfind('\'', 0) == 0 && IsFormula(field.substr(1)) ? field.substr(1) : field;
}

std::string MarkdownParagraph(const std::string& text, const std::string& bullet) {
  constexpr std::size_t kMostBytes = 160;
  std::string paragraph, line = bullet;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const bool marks = std::string("-+*#>|=").find(word[0]) != std::string::npos ||
                       std::isdigit(static_cast<unsigned char>(word[0]));
    if (line.size() > bullet.size() && !marks && line.size() + 1 + word.size() > kMostBytes) {
      paragraph += line + "\n";
      line = std::string(bullet.size(), ' ') + word;
    } else {
      line += (line.size() > bullet.size() ? " " : "") + word;
    }
  }
  return paragraph + line + "\n";
}

}  // namespace volalign
