#pragma once

namespace volalign {

/// In the data folder: the network of configs/structure.yaml that comes with the program.
inline constexpr char kShippedModel[] = "models/m05-lite.safetensors";

}  // namespace volalign
