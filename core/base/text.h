#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace volalign {

/// With small letters, of ASCII.
std::string Lower(std::string text);

/// What stands before, between and behind the separators; an empty text is one empty part.
std::vector<std::string> Split(const std::string& text, char separator);

/// Every line behind `indent`, but for empty ones, and ended.
std::string Indented(const std::string& text, const std::string& indent);

/// Whether a terminal would take a part of the UTF-8 text for an instruction: control characters,
/// those of ISO 8859-1 included.
bool HasControlCharacters(const std::string& text);

/// With control characters as \xNN.
std::string Printable(const std::string& text);

/// What of a file's content stands in a message: Printable, and no more than about `most` bytes.
std::string Shortened(const std::string& text, std::size_t most = 200);

/// The most bytes of a sensor's, a box's or a structure's name: names of files, which are such a
/// name and an ending, have at most 255 bytes on Linux, and tables with longer ones cannot be read.
inline constexpr std::size_t kMostNameBytes = 100;

/// Throws DataError, with `place`, for a name that is longer or has control characters.
void RequirePlainName(const std::string& name, const std::string& place);

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
