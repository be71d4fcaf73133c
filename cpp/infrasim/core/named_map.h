#pragma once

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace infrasim {

/// Values by name, in the order of insertion.
template <class T>
class NamedMap {
 public:
  using mapped_type = T;
  using Entry = std::pair<std::string, T>;

  NamedMap() = default;
  NamedMap(std::initializer_list<Entry> entries) : entries_(entries) {}

  /// Returns the value of a name. A new name is added at the end.
  T& operator[](std::string_view name) {
    const auto entry = std::ranges::find(entries_, name, &Entry::first);
    return entry != entries_.end() ? entry->second
                                   : entries_.emplace_back(std::string(name), T{}).second;
  }
  /// @throws std::out_of_range if the name is missing
  const T& at(std::string_view name) const {
    const auto entry = find(name);
    if (entry == end()) throw std::out_of_range(std::string(name));
    return entry->second;
  }
  auto find(std::string_view name) const {
    return std::ranges::find(entries_, name, &Entry::first);
  }
  void clear() { entries_.clear(); }

  std::size_t size() const { return entries_.size(); }
  bool empty() const { return entries_.empty(); }
  auto begin() { return entries_.begin(); }
  auto end() { return entries_.end(); }
  auto begin() const { return entries_.begin(); }
  auto end() const { return entries_.end(); }

 private:
  std::vector<Entry> entries_;
};

}  // namespace infrasim
