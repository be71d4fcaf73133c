#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "infrasim/core/errors.h"
#include "infrasim/filter/background.h"

namespace infrasim {

static_assert(std::endian::native == std::endian::little);

namespace {

constexpr std::string_view kMagic = "infrasim-background 1\n";

struct Header {
  std::array<double, 5> grid;
  std::array<std::int32_t, 2> cells;
};
static_assert(sizeof(Header) == 48);

void append(std::string& bytes, const void* data, std::size_t size) {
  bytes.append(static_cast<const char*>(data), size);
}

std::vector<float> take_floats(std::string_view bytes, std::size_t begin, std::size_t count) {
  std::vector<float> out(count);
  std::memcpy(out.data(), bytes.data() + begin, count * sizeof(float));
  return out;
}

BackgroundModel empty_model(const Header& header, const std::string& name) {
  const auto& g = header.grid;
  try {
    return empty_background({g[0], g[1], g[2], g[3], g[4]});
  } catch (const std::invalid_argument& error) {
    throw ConfigError(name + ": byte " + std::to_string(kMagic.size()) + ": " + error.what());
  }
}

}  // namespace

std::string background_to_bytes(const BackgroundModel& model) {
  const BackgroundGrid& g = model.grid;
  const Header header{{g.azimuth_cell_deg, g.elevation_cell_deg, g.range_margin_m,
                       g.height_margin_m, g.far_share},
                      {model.azimuth_cells, model.elevation_cells}};
  std::string bytes(kMagic);
  append(bytes, &header, sizeof header);
  append(bytes, model.range_m.data(), model.range_m.size() * sizeof(float));
  append(bytes, model.height_m.data(), model.height_m.size() * sizeof(float));
  return bytes;
}

bool is_background(std::string_view bytes) { return bytes.starts_with(kMagic); }

BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name) {
  const auto fail = [&](std::size_t byte, const std::string& message) -> ConfigError {
    return ConfigError(name + ": byte " + std::to_string(byte) + ": " + message);
  };
  if (!is_background(bytes)) throw fail(0, "not a background model of this version");
  const std::size_t data = kMagic.size() + sizeof(Header);
  if (bytes.size() < data) throw fail(bytes.size(), "the header ends here");
  Header header;
  std::memcpy(&header, bytes.data() + kMagic.size(), sizeof header);
  const std::size_t cells = bytes.size() < data ? 0 : (bytes.size() - data) / (2 * sizeof(float));
  // The cells must be those of the grid; look at the file's size before making room for them.
  const double expected = std::round(360 / header.grid[0]) * std::round(180 / header.grid[1]);
  if ((bytes.size() - data) % (2 * sizeof(float)) != 0 || static_cast<double>(cells) != expected)
    throw fail(data, "found " + std::to_string(bytes.size() - data) + " bytes of cells, allowed is 8 for each cell of the grid");
  BackgroundModel model = empty_model(header, name);
  if (header.cells != std::array<std::int32_t, 2>{model.azimuth_cells, model.elevation_cells})
    throw fail(data - 8, "the numbers of cells do not fit the cell sizes");
  model.range_m = take_floats(bytes, data, cells);
  model.height_m = take_floats(bytes, data + cells * sizeof(float), cells);
  const auto bad_range = [](float r) { return !(r > 0); };
  const auto bad_height = [](float z) { return !(z < 0); };
  if (std::ranges::any_of(model.range_m, bad_range) ||
      std::ranges::any_of(model.height_m, bad_height))
    throw fail(data, "ranges must be above 0 and heights below 0");
  return model;
}

}  // namespace infrasim
