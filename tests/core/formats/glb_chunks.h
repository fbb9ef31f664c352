#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace volalign {

/// The two chunks of a .glb (glTF 2.0, section 4.4), which tinygltf writes.
struct GlbChunks {
  nlohmann::json document;
  std::string binary;

  explicit GlbChunks(const std::string& bytes) {
    std::uint32_t length = 0;
    std::memcpy(&length, &bytes.at(12), sizeof(length));
    document = nlohmann::json::parse(bytes.substr(20, length));
    binary = bytes.substr(28 + length);
  }

  const nlohmann::json& Item(const char* list, const nlohmann::json& index) const {
    return document.at(list).at(index.get<std::size_t>());
  }
  /// Of a tightly packed accessor. `type`: 5126 for float, 5123 for uint16.
  template <class T>
  std::vector<T> Values(const nlohmann::json& index, std::size_t components, int type) const {
    const nlohmann::json& accessor = Item("accessors", index);
    const nlohmann::json& view = Item("bufferViews", accessor.at("bufferView"));
    EXPECT_EQ(accessor.at("componentType"), type);
    std::vector<T> values(accessor.at("count").get<std::size_t>() * components);
    EXPECT_EQ(view.at("byteLength"), values.size() * sizeof(T));
    if (type == 5123) {
      EXPECT_EQ(view.at("target"), 34963) << "indices";
    }
    const std::size_t begin = view.value("byteOffset", 0u) + accessor.value("byteOffset", 0u);
    EXPECT_EQ(begin % 4, 0u) << "not aligned";
    std::memcpy(values.data(), &binary.at(begin), values.size() * sizeof(T));
    return values;
  }
};

}  // namespace volalign
