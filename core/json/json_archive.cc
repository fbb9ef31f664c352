#include "core/json/json_archive.h"

#include <fmt/format.h>

#include <set>
#include <vector>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

using Json = nlohmann::json;

Json ParseStrictJson(const std::string& text, const std::string& name) {
  using Event = Json::parse_event_t;
  std::vector<std::set<std::string>> open;
  std::size_t values = 0;
  std::string problem;
  const auto check = [&](int depth, Event event, Json& parsed) {
    if (event == Event::key) {
      const auto key = parsed.get<std::string>();
      if (!open.back().insert(key).second && problem.empty()) {
        problem =
            fmt::format("the key \"{}\" stands twice in one object; remove one", Shortened(key));
      }
      return true;
    }
    if (event == Event::object_end) open.pop_back();
    if (event == Event::object_end || event == Event::array_end) return true;
    if (event != Event::value && depth >= kMaxJsonDepth) {
      throw DataError(fmt::format("{}: nested deeper than the {} levels that are read of JSON",
                                  name, kMaxJsonDepth));
    }
    if (++values > kMaxJsonValues) {
      throw DataError(
          fmt::format("{}: more than the {} values that are read of JSON", name, kMaxJsonValues));
    }
    if (event == Event::object_start) open.emplace_back();
    if (event == Event::value && parsed.is_null() && problem.empty())
      problem = "a value is null; leave the key out instead";
    return true;
  };
  Json document;
  try {
    document = Json::parse(text, check);
  } catch (const Json::exception& error) {
    const std::string what = error.what();
    const std::size_t id = what.find("] ");
    throw DataError(fmt::format("{}: not valid JSON: {}", name,
                                Shortened(id == std::string::npos ? what : what.substr(id + 2))));
  }
  if (!problem.empty()) throw DataError(name + ": " + problem);
  return document;
}

}  // namespace volalign
