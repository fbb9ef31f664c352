#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace volalign {

/// The two chunks of a .glb, read by the format's own definition (glTF 2.0, section 4.4).
struct GlbChunks {
  nlohmann::json document;
  std::string binary;

  explicit GlbChunks(const std::string& bytes) {
    const auto word = [&](std::size_t at) {
      std::uint32_t value = 0;
      for (std::size_t i = 4; i-- > 0;)
        value = value << 8 | static_cast<std::uint8_t>(bytes.at(at + i));
      return value;
    };
    EXPECT_EQ(bytes.substr(0, 4), "glTF");
    EXPECT_EQ(word(4), 2u);
    EXPECT_EQ(word(8), bytes.size());
    const std::size_t length = word(12), at = 20 + length;
    EXPECT_EQ(bytes.substr(16, 4), "JSON");
    EXPECT_EQ(length % 4, 0u);
    document = nlohmann::json::parse(bytes.substr(20, length));
    EXPECT_EQ(bytes.substr(at + 4, 4), std::string("BIN\0", 4));
    EXPECT_EQ(word(at) % 4, 0u);
    EXPECT_EQ(at + 8 + word(at), bytes.size());
    binary = bytes.substr(at + 8);
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
