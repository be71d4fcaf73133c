#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

#include "fuzz_folder.h"
#include "infrasim/io/ply_file.h"
#include "infrasim/scene/lane_part.h"

// Input: the bytes of a .ply file, whole or behind the start of one, and the rows of a table of
// lanes. They are read or refused with a ConfigError; what was read is in bounds.

namespace {

using namespace infrasim;

void read_surface(std::string_view bytes) {
  static const fuzz::Folder folder;
  const auto file = folder.write("surface.ply", bytes);
  PlySurface surface;
  if (!fuzz::is_done([&] { surface = read_ply(file); })) return;
  fuzz::require(surface.triangles.size() <= bytes.size());
  for (const Vec3& v : surface.vertices) fuzz::require(norm(v) < 1e7);
  for (const auto& triangle : surface.triangles)
    for (const std::uint32_t corner : triangle) fuzz::require(corner < surface.vertices.size());
}

void read_parts(const std::string& text) {
  static const fuzz::Folder folder;
  const auto file = folder.write("lanes.csv", text);
  std::vector<LanePath> lanes;
  if (!fuzz::is_done([&] { lanes = read_lanes(file); })) return;
  for (const LanePath& lane : lanes)
    for (const LanePart& part : parts_within(lane, {0, 0}, 100)) {
      fuzz::require(part.rows.size() >= 2);
      for (const LaneRow& row : part.rows) fuzz::require(norm(row.place) < 100.001);
      for (std::size_t i = 1; i < part.rows.size(); ++i)
        fuzz::require(part.rows[i].s > part.rows[i - 1].s);
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  const std::string vertices =
      "element vertex 3\nproperty float x\nproperty double y\nproperty float z\n";
  read_surface(input);
  read_surface("ply\nformat ascii 1.0\n" + vertices + "end_header\n" + input);
  read_surface("ply\nformat binary_little_endian 1.0\n" + vertices +
               "element face 2\nproperty list uchar int vertex_indices\nend_header\n" + input);
  read_parts("lane,x,y,z,width\na,0,0,0,3\na,9,1,2,3\n" + input);
  return 0;
}
