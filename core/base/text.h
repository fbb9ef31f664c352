#pragma once

#include <string>
#include <vector>

namespace volalign {

/// With small letters, of ASCII.
std::string Lower(std::string text);

/// What stands before, between and behind the separators; an empty text is one empty part.
std::vector<std::string> Split(const std::string& text, char separator);

/// Every line behind `indent`, but for empty ones, and ended.
std::string Indented(const std::string& text, const std::string& indent);

/// A field of a CSV file, in quotes.
std::string CsvQuoted(const std::string& text);

/// A cell of a table in Markdown.
std::string MarkdownCell(std::string text);

}  // namespace volalign
