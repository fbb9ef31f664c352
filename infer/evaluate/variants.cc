#include "infer/evaluate/variants.h"

#include <fmt/format.h>

#include <set>

#include "core/base/error.h"
#include "core/base/text.h"

namespace volalign {

std::vector<EvaluationVariant> ReadVariants(const ConfigSource& source,
                                            const std::string& compare) {
  if (compare.empty()) return {{"volalign", ReadConfig<CalibrateOptions>(source)}};
  const std::size_t equals = compare.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == compare.size()) {
    throw ConfigError(fmt::format(
        "--compare {}: KEY=VALUE,VALUE is expected, as in refine.box_sigma_m=0.004,0.01", compare));
  }
  std::vector<EvaluationVariant> variants;
  std::set<std::string> names;
  for (const std::string& value : Split(compare.substr(equals + 1), ',')) {
    if (!names.insert(value).second) {
      throw ConfigError(fmt::format("--compare {}: {} stands twice", compare, value));
    }
    ConfigSource own = source;
    own.Set(compare.substr(0, equals + 1) + value);
    variants.push_back({value, ReadConfig<CalibrateOptions>(own)});
  }
  return variants;
}

}  // namespace volalign
