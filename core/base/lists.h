#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace volalign {

/// Sorts by key(item), the largest first; equal items keep their order.
template <class T, class Key>
void SortLargestFirst(std::vector<T>* items, const Key& key) {
  std::stable_sort(items->begin(), items->end(),
                   [&](const T& a, const T& b) { return key(a) > key(b); });
}

/// Sorts as SortLargestFirst, and keeps at most `most`.
template <class T, class Key>
void KeepLargest(std::size_t most, std::vector<T>* items, const Key& key) {
  SortLargestFirst(items, key);
  if (items->size() > most)
    items->erase(items->begin() + static_cast<std::ptrdiff_t>(most), items->end());
}

/// At most `most` items, evenly spaced.
template <class T>
std::vector<T> EvenSubset(const std::vector<T>& items, std::size_t most) {
  if (items.size() <= most) return items;
  std::vector<T> some;
  some.reserve(most);
  for (std::size_t i = 0; i < most; ++i) some.push_back(items[i * items.size() / most]);
  return some;
}

/// Appends an item unless same(other) is true for one of the list.
template <class T, class Same>
void AddIfNew(T item, std::vector<T>* items, const Same& same) {
  if (std::none_of(items->begin(), items->end(), same)) items->push_back(std::move(item));
}

}  // namespace volalign
