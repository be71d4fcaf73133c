#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>

namespace infrasim {

/// Parses the whole text as a number, independent of the locale. Returns no value if the text
/// contains a blank or a plus sign, or if the number overflows.
template <class T>
std::optional<T> parse_number(std::string_view text) {
  T value{};
  const char* const begin = text.data();
  const char* const end = begin + text.size();
  const auto [stop, error] = std::from_chars(begin, end, value);
  if (error != std::errc{} || stop != end) return std::nullopt;
  return value;
}

/// Appends a number as printf's %.Nf does in the C locale, independent of the locale.
/// @param digits number of digits after the decimal point, at most 10
inline void append_fixed(std::string& text, double value, int digits) {
  std::array<char, 330> buffer{};  // the largest double has 309 digits before the point
  char* const end = buffer.data() + buffer.size();
  text.append(buffer.data(),
              std::to_chars(buffer.data(), end, value, std::chars_format::fixed, digits).ptr);
}

inline std::string fixed_text(double value, int digits) {
  std::string text;
  append_fixed(text, value, digits);
  return text;
}

/// Returns the 16 hexadecimal digits of a number.
inline std::string hex_text(std::uint64_t value) {
  std::array<char, 17> text{};
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(value));
  return text.data();
}

}  // namespace infrasim
