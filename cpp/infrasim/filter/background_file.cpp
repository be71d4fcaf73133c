#include <algorithm>
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

/// The header of a background file. Only the elevation rows from the first to the last with a
/// background are stored.
struct Header {
  std::int32_t azimuth_cells, elevation_cells, first_row, rows;
};
constexpr std::size_t kData = kMagic.size() + sizeof(Header);

Header header_of(const BackgroundModel& model) {
  const auto seen = [](float range) { return range != kUnseen; };
  const auto& r = model.range_m;
  const auto first = std::ranges::find_if(r, seen) - r.begin();
  const auto after = r.rend() - std::find_if(r.rbegin(), r.rend(), seen);
  if (after <= first) return {model.azimuth_cells, model.elevation_cells, 0, 0};
  const auto first_row = static_cast<std::int32_t>(first / model.azimuth_cells);
  const auto last_row = static_cast<std::int32_t>((after - 1) / model.azimuth_cells);
  return {model.azimuth_cells, model.elevation_cells, first_row, last_row - first_row + 1};
}

[[noreturn]] void fail(const std::string& name, std::size_t byte, const std::string& message) {
  throw ConfigError(name + ": byte " + std::to_string(byte) + ": " + message);
}

Header read_header(std::string_view bytes, const std::string& name) {
  if (!is_background(bytes)) fail(name, 0, "expected a background model, got another kind of file");
  if (bytes.size() < kData) fail(name, bytes.size(), "expected a header, got the end of the file");
  Header h;
  std::memcpy(&h, bytes.data() + kMagic.size(), sizeof h);
  const auto is_count = [](std::int32_t n) { return n >= 1 && n <= 7200; };
  if (!is_count(h.azimuth_cells) || !is_count(h.elevation_cells))
    fail(name, kMagic.size(),
         "expected 1 to 7200 cells along azimuth and elevation, got " +
             std::to_string(h.azimuth_cells) + " x " + std::to_string(h.elevation_cells) +
             " cells");
  if (h.first_row < 0 || h.rows < 0 || h.first_row > h.elevation_cells - h.rows)
    fail(name, kMagic.size() + 8,
         "expected stored rows within the elevation cells, got rows beyond them");
  const std::size_t expected = std::size_t{2} * h.rows * h.azimuth_cells * sizeof(float);
  if (bytes.size() - kData != expected)
    fail(name, kData,
         "expected " + std::to_string(expected) + " bytes of cells, got " +
             std::to_string(bytes.size() - kData) + " bytes");
  return h;
}

}  // namespace

std::string background_to_bytes(const BackgroundModel& model) {
  const Header h = header_of(model);
  std::string bytes(kMagic);
  bytes.append(reinterpret_cast<const char*>(&h), sizeof h);
  for (const auto* values : {&model.range_m, &model.height_m})
    bytes.append(reinterpret_cast<const char*>(values->data() + h.first_row * h.azimuth_cells),
                 static_cast<std::size_t>(h.rows) * h.azimuth_cells * sizeof(float));
  return bytes;
}

bool is_background(std::string_view bytes) { return bytes.starts_with(kMagic); }

BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name) {
  const Header h = read_header(bytes, name);
  const std::size_t cells = static_cast<std::size_t>(h.azimuth_cells) * h.elevation_cells;
  BackgroundModel model{h.azimuth_cells, h.elevation_cells, std::vector<float>(cells, kUnseen),
                        std::vector<float>(cells, -kUnseen)};
  const std::size_t size = static_cast<std::size_t>(h.rows) * h.azimuth_cells * sizeof(float);
  std::size_t from = kData;
  for (auto* values : {&model.range_m, &model.height_m}) {
    std::memcpy(values->data() + h.first_row * h.azimuth_cells, bytes.data() + from, size);
    if (std::ranges::any_of(*values, [](float v) { return std::isnan(v); }))
      fail(name, from, "expected numbers, got a NaN");
    from += size;
  }
  return model;
}

}  // namespace infrasim
