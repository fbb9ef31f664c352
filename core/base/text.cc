#include "core/base/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <new>
#include <sstream>
#include <system_error>
#include <utility>

#include "core/base/error.h"
#include "core/base/number.h"

namespace volalign {

Error::Error(const std::string& message) : std::runtime_error(MessageLine(message)) {}

namespace {

/// A formula may have apostrophes before it. CsvQuoted and CsvText would otherwise confuse them
/// with their own.
bool IsFormula(const std::string& text) {
  const std::size_t begin = text.find_first_not_of('\'');
  if (begin == std::string::npos || std::string("=+-@").find(text[begin]) == std::string::npos) {
    return false;
  }
  const std::string cell = text.substr(begin);
  return begin > 0 || !NumberOf(cell);
}

/// Beginning of the UTF-8 character that contains the byte `at`.
std::size_t LetterBegin(const std::string& text, std::size_t at) {
  while (at > 0 && (static_cast<unsigned char>(text[at]) & 0xc0) == 0x80) --at;
  return at;
}

/// Control characters, characters that change the direction of text or end a line, and those
/// without width that belong to no script.
bool IsHidden(std::uint32_t code) {
  constexpr std::pair<std::uint32_t, std::uint32_t> kHidden[] = {
      {0, 0x1f},        {0x7f, 0x9f},     {0xad, 0xad},      {0x61c, 0x61c},
      {0x200b, 0x200b}, {0x200e, 0x200f}, {0x2028, 0x202e},  {0x2060, 0x206f},
      {0xfeff, 0xfeff}, {0xfff9, 0xfffb}, {0xe0000, 0xe007f}};
  return std::any_of(std::begin(kHidden), std::end(kHidden), [&](const auto& range) {
    return code >= range.first && code <= range.second;
  });
}

}  // namespace

Letter LetterAt(const std::string& text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[at + i]); };
  if (byte(0) < 0x80) return {byte(0), 1};
  const std::size_t bytes = byte(0) < 0xc2   ? 0
                            : byte(0) < 0xe0 ? 2
                            : byte(0) < 0xf0 ? 3
                            : byte(0) < 0xf5 ? 4
                                             : 0;
  if (bytes == 0 || at + bytes > text.size()) return {};
  std::uint32_t code = byte(0) & (0xffU >> (bytes + 1));
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return {};
    code = code << 6 | (byte(i) & 0x3fU);
  }
  constexpr std::uint32_t kLeast[] = {0x80, 0x800, 0x10000};
  if (code < kLeast[bytes - 2] || code > 0x10ffff || (code >= 0xd800 && code < 0xe000)) return {};
  return {code, bytes};
}

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

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

std::string Indented(const std::string& text, const std::string& indent) {
  std::string indented;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    indented += (line.empty() ? "" : indent + line) + "\n";
  return indented;
}

std::string Printable(const std::string& text) {
  std::string printable;
  for (std::size_t i = 0; i < text.size();) {
    const Letter letter = LetterAt(text, i);
    if (letter.bytes == 0) {
      printable += fmt::format("\\x{:02x}", static_cast<unsigned char>(text[i++]));
      continue;
    }
    if (!IsHidden(letter.code)) {
      printable.append(text, i, letter.bytes);
    } else {
      printable += fmt::format(letter.code < 0x100 ? "\\x{:02x}" : "\\u{:04x}", letter.code);
    }
    i += letter.bytes;
  }
  return printable;
}

bool IsUtf8(const std::string& text) {
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t bytes = LetterAt(text, i).bytes;
    if (bytes == 0) return false;
    i += bytes;
  }
  return true;
}

void RequireUtf8(const std::string& text, const std::string& what) {
  if (IsUtf8(text)) return;
  throw DataError(fmt::format(
      "{} \"{}\" is not UTF-8, which the files of a result have to be; rename the file or the "
      "folder, or write the text in UTF-8",
      what, Shortened(text)));
}

std::string Shortened(const std::string& text, std::size_t most) {
  if (text.size() <= most) return Printable(text);
  return Printable(text.substr(0, LetterBegin(text, most))) + "...";
}

std::string ShownPath(const std::filesystem::path& path) { return Shortened(path.string(), 500); }

std::string SentenceOf(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return "there is not enough memory for this";
  if (const auto* of_file = dynamic_cast<const std::filesystem::filesystem_error*>(&error))
    return fmt::format("{}: {}", ShownPath(of_file->path1()), of_file->code().message());
  const auto* const of_system = dynamic_cast<const std::system_error*>(&error);
  if (of_system && of_system->code() == std::errc::resource_unavailable_try_again) {
    return "the system gives no more threads or processes (ulimit -u); end some of them, or ask "
           "for fewer threads";
  }
  return MessageLine(FirstLine(error.what()));
}

std::string MessageLine(const std::string& text) {
  constexpr std::size_t kMost = 1500, kEnd = 500;  // bytes, and of them those of the end
  const std::string line = Printable(text.substr(0, text.find_last_not_of('\n') + 1));
  if (line.size() <= kMost) return line;
  return line.substr(0, LetterBegin(line, kMost - kEnd)) + " ... " +
         line.substr(LetterBegin(line, line.size() - kEnd));
}

bool IsPlainName(const std::string& name) {
  return name.size() <= kMostNameBytes && Printable(name) == name;
}

void RequirePlainName(const std::string& name, const std::string& place) {
  if (IsPlainName(name)) return;
  throw DataError(fmt::format(
      "{}: the name \"{}\" has control characters, characters that are not seen or not UTF-8, or "
      "more than {} bytes; use a plain word",
      place, Shortened(name, kMostNameBytes), kMostNameBytes));
}

void RequirePlainText(const std::string& text, const std::string& place) {
  if (Shortened(text) == text) return;
  throw DataError(fmt::format(
      "{} = \"{}\" has control characters, characters that are not seen or not UTF-8, or more than "
      "200 bytes; write plain text",
      place, Shortened(text)));
}

std::string CsvQuoted(const std::string& text) {
  std::string quoted = IsFormula(text) ? "\"'" : "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + "\"";
}

std::string CsvText(const std::string& field) {
  return field.rfind('\'', 0) == 0 && IsFormula(field.substr(1)) ? field.substr(1) : field;
}

}  // namespace volalign
