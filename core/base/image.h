#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace volalign {

/// The steps from a pixel to the four beside it.
inline constexpr std::array<std::pair<int, int>, 4> kBeside = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

/// Row-major image; pixel (u, v) is column u of row v, its centre at integer coordinates.
template <class T>
class Image {
 public:
  Image() = default;
  Image(int width, int height, T value = T())
      : width_(width),
        height_(height),
        data_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), value) {}

  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t size() const { return data_.size(); }
  bool empty() const { return data_.empty(); }
  bool Contains(int u, int v) const { return u >= 0 && v >= 0 && u < width_ && v < height_; }

  T& operator()(int u, int v) { return data_[Index(u, v)]; }
  const T& operator()(int u, int v) const { return data_[Index(u, v)]; }
  T& operator[](std::size_t i) { return data_[i]; }
  const T& operator[](std::size_t i) const { return data_[i]; }

  T* data() { return data_.data(); }
  const T* data() const { return data_.data(); }
  auto begin() { return data_.begin(); }
  auto end() { return data_.end(); }
  auto begin() const { return data_.begin(); }
  auto end() const { return data_.end(); }

  friend bool operator==(const Image& a, const Image& b) {
    return a.width_ == b.width_ && a.height_ == b.height_ && a.data_ == b.data_;
  }

 private:
  std::size_t Index(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(u);
  }

  int width_ = 0;
  int height_ = 0;
  std::vector<T> data_;
};

struct Rgb {
  std::uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(Rgb x, Rgb y) { return x.r == y.r && x.g == y.g && x.b == y.b; }
};

/// Depth along the optical axis in metres; 0 is "no measurement".
using DepthImage = Image<float>;
/// Side labels; 0 is background.
using LabelImage = Image<std::uint8_t>;
using Image16 = Image<std::uint16_t>;
using RgbImage = Image<Rgb>;

/// Turns the image by `quarter_turns` x 90 deg clockwise (as seen on a screen, u right, v down).
/// One turn sends the pixel (u, v) to (height - 1 - v, u). Any integer is accepted, modulo 4.
template <class T>
Image<T> Turn(const Image<T>& image, int quarter_turns) {
  const int turns = ((quarter_turns % 4) + 4) % 4;
  if (turns == 0) return image;
  const int w = image.width(), h = image.height();
  Image<T> out(turns == 2 ? w : h, turns == 2 ? h : w);
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      if (turns == 1) out(h - 1 - v, u) = image(u, v);
      if (turns == 2) out(w - 1 - u, h - 1 - v) = image(u, v);
      if (turns == 3) out(v, w - 1 - u) = image(u, v);
    }
  }
  return out;
}

}  // namespace volalign
