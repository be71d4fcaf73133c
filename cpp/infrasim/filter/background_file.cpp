#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "infrasim/core/errors.h"
#include "infrasim/filter/background.h"

namespace infrasim {

static_assert(std::endian::native == std::endian::little);

namespace {

constexpr std::string_view kMagic = "infrasim-background 1\n";
using CellCounts = std::array<std::int32_t, 2>;
constexpr std::size_t kData = kMagic.size() + sizeof(CellCounts);

std::vector<float> floats_at(std::string_view bytes, std::size_t begin, std::size_t count) {
  std::vector<float> out(count);
  std::memcpy(out.data(), bytes.data() + begin, count * sizeof(float));
  return out;
}

bool has_nan(const std::vector<float>& values) {
  return std::ranges::any_of(values, [](float v) { return std::isnan(v); });
}

}  // namespace

std::string background_to_bytes(const BackgroundModel& model) {
  std::string bytes(kMagic);
  const auto append = [&](const void* data, std::size_t size) {
    bytes.append(static_cast<const char*>(data), size);
  };
  const CellCounts counts{model.azimuth_cells, model.elevation_cells};
  append(counts.data(), sizeof counts);
  append(model.range_m.data(), model.range_m.size() * sizeof(float));
  append(model.height_m.data(), model.height_m.size() * sizeof(float));
  return bytes;
}

bool is_background(std::string_view bytes) { return bytes.starts_with(kMagic); }

BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name) {
  const auto fail = [&](std::size_t byte, const std::string& message) {
    return ConfigError(name + ": byte " + std::to_string(byte) + ": " + message);
  };
  if (!is_background(bytes)) throw fail(0, "not a background model of this version");
  if (bytes.size() < kData) throw fail(bytes.size(), "the file ends inside the header");
  CellCounts counts;
  std::memcpy(counts.data(), bytes.data() + kMagic.size(), sizeof counts);
  const auto [azimuth_cells, elevation_cells] = counts;
  if (std::min(azimuth_cells, elevation_cells) < 1 || std::max(azimuth_cells, elevation_cells) > 7200)
    throw fail(kMagic.size(), "found " + std::to_string(azimuth_cells) + " x " +
                                  std::to_string(elevation_cells) +
                                  " cells, allowed is 1 to 7200 each way");
  const std::size_t cells = static_cast<std::size_t>(azimuth_cells) * elevation_cells;
  if (bytes.size() - kData != cells * 2 * sizeof(float))
    throw fail(kData, "found " + std::to_string(bytes.size() - kData) + " bytes of cells, allowed is " +
                          std::to_string(cells * 2 * sizeof(float)));
  BackgroundModel model{azimuth_cells, elevation_cells, floats_at(bytes, kData, cells),
                        floats_at(bytes, kData + cells * sizeof(float), cells)};
  if (has_nan(model.range_m) || has_nan(model.height_m)) throw fail(kData, "found a NaN, allowed are numbers");
  return model;
}

}  // namespace infrasim
