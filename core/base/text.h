#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

namespace volalign {

/// In lower case, for ASCII.
std::string Lower(std::string text);

/// The parts between the separators; an empty text is one empty part.
std::vector<std::string> Split(const std::string& text, char separator);

/// The text up to the first line feed. Libraries put traces behind it.
std::string FirstLine(const std::string& text);

/// Puts `indent` before every line that is not empty. Every line is ended.
std::string Indented(const std::string& text, const std::string& indent);

/// The text as a person sees it, in UTF-8 for any bytes. Control characters and bytes that are no
/// UTF-8 become \xNN. Characters that turn, break or hide their neighbours become \uNNNN.
std::string Printable(const std::string& text);

/// A character of UTF-8; 0 bytes if there is none.
struct Letter {
  std::uint32_t code = 0;
  std::size_t bytes = 0;
};
/// The character at `at` by RFC 3629: in the fewest bytes, no half of a pair of UTF-16.
Letter LetterAt(const std::string& text, std::size_t at);

bool IsUtf8(const std::string& text);
/// Throws DataError, which begins with `what`, for a text that is not UTF-8. For paths and texts of
/// callers, which are written to JSON and YAML later.
void RequireUtf8(const std::string& text, const std::string& what);

/// A quotation from a file for a message: Printable, and at most about `most` bytes.
std::string Shortened(const std::string& text, std::size_t most = 200);

/// A path for a message: Shortened. Linux has no path of more than 4,096 bytes, and hardly anybody
/// one of more than 500.
std::string ShownPath(const std::filesystem::path& path);

/// A sentence for an exception of the system or a library: one line, as a MessageLine, with the
/// file or the limit if there is one.
std::string SentenceOf(const std::exception& error);

/// The message of every Error: Printable, one line, at most about 1,500 bytes. A longer one loses
/// its middle, as its end often says what to do.
std::string MessageLine(const std::string& text);

/// The most bytes of a sensor's, a box's or a structure's name. Names of files, such a name with an
/// ending, have at most 255 bytes on Linux. Tables with longer names cannot be read.
inline constexpr std::size_t kMostNameBytes = 100;

/// Can a name stand in files and in tables? It is not too long, and Printable does not change it.
bool IsPlainName(const std::string& name);
/// Throws DataError, with `place`, for any other name.
void RequirePlainName(const std::string& name, const std::string& place);

/// Throws DataError, with `place`, for a text that Shortened changes. For texts that are copied to
/// results and printed, as a serial number.
void RequirePlainText(const std::string& text, const std::string& place);

/// A field of a CSV file, in quotes. A spreadsheet takes a text for a formula if it begins with =,
/// +, - or @ and is no number. Such a text, also with apostrophes before it, gets one more
/// apostrophe; CsvText removes it.
std::string CsvQuoted(const std::string& text);
/// The inverse of CsvQuoted, for a field without its quotes.
std::string CsvText(const std::string& field);

}  // namespace volalign
