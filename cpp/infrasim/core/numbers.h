#pragma once

#include <charconv>
#include <optional>
#include <string_view>

namespace infrasim {

/// The whole text as a number, in any locale; nothing for blanks, a plus sign or what is too large.
template <class T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const char* const begin = text.data();
  const char* const end = begin + text.size();
  const auto [stop, error] = std::from_chars(begin, end, value);
  if (error != std::errc{} || stop != end) return std::nullopt;
  return value;
}

}  // namespace infrasim
