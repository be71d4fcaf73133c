#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace infrasim {

/// LZF, the compression inside `binary_compressed` PCD files: runs of literal bytes (control byte
/// below 32: length - 1) and references back (3 bits of length - 2, 13 bits of distance - 1; length
/// bits 7 mean one more length byte).
std::string lzf_compress(std::string_view bytes);

/// @param size  bytes that must come out
/// @return nothing if the data is not LZF of exactly that size
std::optional<std::string> lzf_decompress(std::string_view bytes, std::size_t size);

}  // namespace infrasim
