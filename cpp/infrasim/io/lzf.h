#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace infrasim {

/// Compresses bytes with LZF, the compression in `binary_compressed` PCD files. The compressed data
/// has two kinds of items. A run of literal bytes begins with a control byte below 32, which is the
/// length - 1. A back reference has 3 bits for the length - 2 and 13 bits for the distance - 1. If
/// the 3 bits are 7, one more byte of the length follows.
std::string lzf_compress(std::string_view bytes);

/// @param size  expected number of decompressed bytes
/// @return no value if the data is not LZF of exactly that size
std::optional<std::string> lzf_decompress(std::string_view bytes, std::size_t size);

}  // namespace infrasim
