#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace volalign {

/// With small letters, of ASCII.
std::string Lower(std::string text);

/// What stands before, between and behind the separators; an empty text is one empty part.
std::vector<std::string> Split(const std::string& text, char separator);

/// Up to the first line feed: libraries put traces behind it.
std::string FirstLine(const std::string& text);

/// With longer lines broken at blanks into such of at most `width` bytes where no word is longer,
/// each but the first indented by two.
std::string Wrapped(const std::string& text, std::size_t width);

/// Every line behind `indent`, but for empty ones, and ended.
std::string Indented(const std::string& text, const std::string& indent);

/// Whether Printable changes the text.
bool HasControlCharacters(const std::string& text);

/// As a person sees it, and in UTF-8 whatever the bytes are: control characters, bytes that are no
/// UTF-8 as \xNN, and characters that turn, break or hide what stands beside them as \uNNNN.
std::string Printable(const std::string& text);

bool IsUtf8(const std::string& text);
/// Throws DataError, which begins with `what`, for a text that is not UTF-8. For paths and texts
/// that callers give: they stand in JSON and YAML later.
void RequireUtf8(const std::string& text, const std::string& what);

/// What of a file's content stands in a message: Printable, and no more than about `most` bytes.
std::string Shortened(const std::string& text, std::size_t most = 200);

/// A message as every Error has it: Printable, one line, no more than about 1,500 bytes. Of a
/// longer one the middle is left out, as its end often says what to do.
std::string MessageLine(const std::string& text);

/// The most bytes of a sensor's, a box's or a structure's name: names of files, which are such a
/// name and an ending, have at most 255 bytes on Linux, and tables with longer ones cannot be read.
inline constexpr std::size_t kMostNameBytes = 100;

/// Whether a name can stand in files and in tables: it is no longer, and Printable leaves it alone.
bool IsPlainName(const std::string& name);
/// Throws DataError, with `place`, for another one.
void RequirePlainName(const std::string& name, const std::string& place);

/// Throws DataError, with `place`, for a text that Shortened changes: of texts that are carried
/// into results and printed, as the number of a device.
void RequirePlainText(const std::string& text, const std::string& place);

/// A field of a CSV file, in quotes. A text that a spreadsheet would take for a formula (it begins
/// with =, +, - or @ and is no number) has an apostrophe before it, as has one with apostrophes
/// before that; CsvText takes it away.
std::string CsvQuoted(const std::string& text);
/// What CsvQuoted was given, of a field without its quotes.
std::string CsvText(const std::string& field);

/// A paragraph of Markdown, ended, in lines of at most 160 bytes where no word is longer. With a
/// bullet ("- ") an item of a list. No line of it begins with what Markdown takes for a list, a
/// heading, a quotation or a table.
std::string MarkdownParagraph(const std::string& text, const std::string& bullet = "");

}  // namespace volalign
