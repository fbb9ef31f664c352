#include <fmt/format.h>
#include <fmt/ranges.h>

#include "cli/app_tree.h"
#include "core/base/text.h"

namespace volalign {

namespace {

std::string OptionRow(const CLI::Option* option) {
  const std::string name = option->get_positional()
                               ? option->get_name(/*positional=*/true)
                               : option->get_name(/*positional=*/false, /*all=*/true);
  std::string meaning = option->get_description();
  if (const auto words = Choices(option); !words.empty())
    meaning += fmt::format(" ({})", fmt::join(words, ", "));
  if (const std::string limits = Limits(option); !limits.empty()) meaning += "; " + limits;
  if (option->get_required()) meaning += "; required";
  if (!option->get_default_str().empty())
    meaning += fmt::format("; default {}", option->get_default_str());
  return MarkdownParagraph(fmt::format("`{}`: {}", name, meaning), "- ");
}

std::string Section(const CLI::App* app, const std::string& path) {
  std::string text = fmt::format("\n## volalign {}\n\n{}\n", path,
                                 MarkdownParagraph(app->get_description() + "."));
  for (const CLI::Option* option :
       app->get_options([](const CLI::Option* o) { return o->get_positional(); }))
    text += OptionRow(option);
  for (const CLI::Option* option :
       app->get_options([](const CLI::Option* o) { return !o->get_positional(); })) {
    if (option->check_lname("help") || option->check_lname("data-dir")) continue;
    text += OptionRow(option);
  }
  const std::string footer = app->get_footer(), title = "Example:\n";
  if (const std::size_t at = footer.find(title); at != std::string::npos)
    text += "\n" + Indented(footer.substr(at + title.size()), "  ");
  return text;
}

}  // namespace

std::string CommandReference(CLI::App* program) {
  std::string text = "# Command line\n";
  ForEachApp(program, [&](CLI::App* app, const std::string& path) {
    if (CommandNames(app).empty()) text += Section(app, path);
  });
  return text;
}

}  // namespace volalign
