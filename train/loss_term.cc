#include "train/loss_term.h"

#include <fmt/format.h>

#include <map>
#include <utility>

#include "core/base/error.h"

namespace volalign {
namespace {

std::map<std::string, LossTermFactory>& Registered() {
  // The paper's terms loss_seg and loss_3d always exist (train/losses.h).
  static std::map<std::string, LossTermFactory> registered = {{"seg", nullptr}, {"3d", nullptr}};
  return registered;
}

}  // namespace

void RegisterLossTerm(const std::string& name, LossTermFactory factory) {
  if (!Registered().emplace(name, std::move(factory)).second)
    throw Error(fmt::format("there is a loss term '{}' already", name));
}

std::unique_ptr<LossTerm> MakeLossTerm(const std::string& name, const Structure& structure,
                                       const at::Device& device) {
  const auto found = Registered().find(name);
  if (found == Registered().end() || !found->second) {
    throw ConfigError(
        fmt::format("loss.terms: '{}' is unknown: volalign has none of its own; a program "
                    "registers them (train/loss_term.h)",
                    name));
  }
  return found->second(structure, device);
}

}  // namespace volalign
