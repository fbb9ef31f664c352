#pragma once

namespace volalign {

/// The pixels of a picture, row by row: `for (const auto [u, v] : Pixels(depth))`.
class Pixels {
 public:
  struct Pixel {
    int u, v;
  };
  class Iterator {
   public:
    Iterator(const Pixels& pixels, Pixel at) : pixels_(pixels), at_(at) {}
    Pixel operator*() const { return at_; }
    bool operator!=(const Iterator& end) const { return at_.v < end.at_.v; }
    Iterator& operator++() {
      if (++at_.u == pixels_.end_.u) at_ = {pixels_.first_.u, at_.v + 1};
      return *this;
    }

   private:
    const Pixels& pixels_;
    Pixel at_;
  };

  /// Of whatever has a width() and a height().
  template <class Picture>
  explicit Pixels(const Picture& picture) : Pixels(picture.width(), picture.height()) {}
  Pixels(int width, int height) : Pixels({0, 0}, {width, height}) {}
  /// Columns `first.u` to `end.u` - 1 of the rows `first.v` to `end.v` - 1.
  Pixels(Pixel first, Pixel end) : first_(first), end_(end) {}

  Iterator begin() const { return {*this, first_.u < end_.u ? first_ : end_}; }
  Iterator end() const { return {*this, end_}; }

 private:
  Pixel first_, end_;
};

}  // namespace volalign
