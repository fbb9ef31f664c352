#pragma once

namespace volalign {

/// The network of configs/structure.yaml that comes with the program, in the data folder.
inline constexpr char kShippedModel[] = "models/m05-lite.safetensors";

}  // namespace volalign
