#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace infrasim {

/// LZF, the compression in `binary_compressed` PCD files. It has runs of literal bytes (a control
/// byte below 32 is length - 1) and back references (3 bits of length - 2, 13 bits of distance - 1;
/// length bits of 7 mean that one more length byte follows).
std::string lzf_compress(std::string_view bytes);

/// @param size  expected number of decompressed bytes
/// @return nothing if the data is not LZF of exactly that size
std::optional<std::string> lzf_decompress(std::string_view bytes, std::size_t size);

}  // namespace infrasim
