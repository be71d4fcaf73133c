#include "infrasim/core/errors.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>

namespace infrasim {

namespace {

/// Returns the number of bytes of the printable character at the start of the text; 0 if there is
/// none.
std::size_t character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x80) return byte(0) >= 32 && byte(0) != 127 ? 1 : 0;
  const std::size_t length = byte(0) < 0xC2 ? 0 : byte(0) < 0xE0 ? 2 : byte(0) < 0xF0 ? 3 : 4;
  if (length == 0 || length > text.size()) return 0;
  std::uint32_t point = byte(0) & (0xFFU >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
    point = point << 6 | (byte(i) & 0x3FU);
  }
  constexpr std::array<std::uint32_t, 5> kSmallest{0, 0, 0xA0, 0x800, 0x10000};
  const bool surrogate = point >= 0xD800 && point < 0xE000;
  return point >= kSmallest[length] && point < 0x110000 && !surrogate ? length : 0;
}

}  // namespace

std::size_t find_unprintable(std::string_view text, std::size_t from) {
  while (from < text.size()) {
    const std::size_t length = character(text.substr(from));
    if (length == 0) return from;
    from += length;
  }
  return std::string_view::npos;
}

std::string printable(std::string_view text) {
  std::string out;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(find_unprintable(text, begin), text.size());
    out += text.substr(begin, end - begin);
    begin = end + 1;
    if (end == text.size()) break;
    std::array<char, 5> escaped{};
    std::snprintf(escaped.data(), escaped.size(), "\\x%02x", static_cast<unsigned char>(text[end]));
    out += escaped.data();
  }
  return out;
}

}  // namespace infrasim
