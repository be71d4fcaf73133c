#include "infrasim/io/lzf.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace infrasim {

namespace {

constexpr std::size_t kMaxLiterals = 32;
constexpr std::size_t kMaxLength = 264;
constexpr std::size_t kMaxDistance = 8192;
constexpr std::size_t kHashBits = 14;

void flush_literals(std::string_view bytes, std::size_t from, std::size_t to, std::string& out) {
  while (from < to) {
    const std::size_t n = std::min(kMaxLiterals, to - from);
    out += static_cast<char>(n - 1);
    out.append(bytes.substr(from, n));
    from += n;
  }
}

void put_reference(std::size_t length, std::size_t distance, std::string& out) {
  const std::size_t short_length = std::min<std::size_t>(length - 2, 7);
  out += static_cast<char>((short_length << 5) | ((distance - 1) >> 8));
  if (short_length == 7) out += static_cast<char>(length - 2 - 7);
  out += static_cast<char>((distance - 1) & 0xFF);
}

std::size_t hash3(std::string_view bytes, std::size_t i) {
  const auto at = [&](std::size_t k) {
    return static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i + k]));
  };
  return ((at(0) << 16 | at(1) << 8 | at(2)) * 2654435761U) >> (32 - kHashBits);
}

}  // namespace

std::string lzf_compress(std::string_view bytes) {
  constexpr auto kNone = static_cast<std::size_t>(-1);
  std::vector<std::size_t> last(std::size_t{1} << kHashBits, kNone);
  std::string out;
  std::size_t literal = 0, i = 0;
  while (i + 2 < bytes.size()) {
    std::size_t& slot = last[hash3(bytes, i)];
    const std::size_t candidate = slot;
    slot = i;
    std::size_t length = 0;
    if (candidate != kNone && i - candidate <= kMaxDistance) {
      const std::size_t limit = std::min(kMaxLength, bytes.size() - i);
      while (length < limit && bytes[candidate + length] == bytes[i + length]) ++length;
    }
    if (length < 3) {
      ++i;
      continue;
    }
    flush_literals(bytes, literal, i, out);
    put_reference(length, i - candidate, out);
    i += length;
    literal = i;
  }
  flush_literals(bytes, literal, bytes.size(), out);
  return out;
}

std::optional<std::string> lzf_decompress(std::string_view bytes, std::size_t size) {
  std::string out;
  out.reserve(std::min(size, bytes.size() * kMaxLength));
  std::size_t i = 0;
  const auto next = [&] {
    return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i++]));
  };
  while (i < bytes.size()) {
    const std::size_t control = next();
    if (control < kMaxLiterals) {
      const std::size_t n = control + 1;
      if (n > bytes.size() - i || n > size - out.size()) return std::nullopt;
      out.append(bytes.substr(i, n));
      i += n;
      continue;
    }
    std::size_t length = (control >> 5) + 2;
    if (length == 9) {
      if (i == bytes.size()) return std::nullopt;
      length += next();
    }
    if (i == bytes.size()) return std::nullopt;
    const std::size_t distance = ((control & 0x1F) << 8 | next()) + 1;
    if (distance > out.size() || length > size - out.size()) return std::nullopt;
    // The copy is byte by byte, because a reference may overlap with the bytes that it appends.
    for (std::size_t k = 0; k < length; ++k) out += out[out.size() - distance];
  }
  if (out.size() != size) return std::nullopt;
  return out;
}

}  // namespace infrasim
