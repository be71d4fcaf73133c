#include "infrasim/scene/lane_file.h"

#include <algorithm>
#include <set>

#include "infrasim/config/fields.h"
#include "infrasim/core/math.h"
#include "infrasim/io/csv.h"

namespace infrasim {

namespace {

constexpr double kLeastStep = 1e-4;  // m, minimum distance between consecutive rows of a lane
// m, distance along a lane from an end within which a station counts as the end
constexpr double kAtEnd = 1e-6;

struct LaneFileRow {
  Vec2 place;
  double z;
  double width;
};

/// Returns the rows with directions. A row's direction is from the previous row to the next one.
std::vector<CurvePoint> directed(const std::vector<LaneFileRow>& rows) {
  std::vector<CurvePoint> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Vec2 from = rows[i == 0 ? 0 : i - 1].place;
    const Vec2 to = rows[std::min(i + 1, rows.size() - 1)].place;
    out.push_back({rows[i].place, math::atan2(to.y - from.y, to.x - from.x)});
  }
  return out;
}

LanePath path_of(const std::string& name, const std::vector<LaneFileRow>& rows) {
  LanePath lane{name, Curve(directed(rows)), {}, {}};
  for (const LaneFileRow& row : rows) {
    lane.z.push_back(row.z);
    lane.width_m.push_back(row.width);
  }
  return lane;
}

/// Reads a file of lanes row by row and reports errors with their position.
class LaneReader {
 public:
  explicit LaneReader(const std::filesystem::path& file) : csv_(file, "lane,x,y,z,width") {}

  std::vector<LanePath> read() {
    while (csv_.next_row()) row();
    finish();
    if (out_.empty()) csv_.fail_row("lane", "expected a lane, got none");
    return std::move(out_);
  }

 private:
  void row() {
    const std::string name(csv_.cell());
    if (!config::begins_as_name(name) || name.size() > 100)
      csv_.fail("lane", "expected a short name that begins with a letter, a digit or _, got '" +
                            name.substr(0, 40) + "'");
    const LaneFileRow row{{csv_.number("x", -1e6, 1e6), csv_.number("y", -1e6, 1e6)},
                          csv_.number("z", -1e3, 1e4),
                          csv_.number("width", 0.5, 100)};
    if (name != name_) {
      finish();
      if (!names_.insert(name).second)
        csv_.fail_row("lane",
                      "expected the rows of a lane together, got lane '" + name + "' again");
      name_ = name;
    } else if (norm(row.place - rows_.back().place) < kLeastStep) {
      csv_.fail_row("x", "expected " + config::number_text(kLeastStep) +
                             " m or more from the point of the row above, got a nearer point");
    }
    rows_.push_back(row);
  }

  void finish() {
    if (rows_.size() == 1)
      csv_.fail_row("lane", "expected two or more rows, got one row of lane '" + name_ + "'");
    if (!rows_.empty()) out_.push_back(path_of(name_, rows_));
    rows_.clear();
  }

  CsvReader csv_;
  std::string name_;
  std::set<std::string> names_;
  std::vector<LaneFileRow> rows_;
  std::vector<LanePath> out_;
};

}  // namespace

std::vector<LanePath> read_lanes(const std::filesystem::path& file) {
  return LaneReader(file).read();
}

std::vector<LanePath> lanes_of(const SceneConfig& scene) {
  if (!scene.lanes) return {};
  return config::read_named(scene.lanes_key,
                            [&] { return read_lanes(scene.folder / *scene.lanes); });
}

std::vector<LaneLevel> lane_levels(std::span<const LanePath> lanes, Vec2 place) {
  std::vector<LaneLevel> out;
  for (const LanePath& lane : lanes) {
    const double s = lane.line.project(place);
    const CurvePoint p = lane.line.at(s);
    const Vec2 off = place - p.position;
    const bool at_end = s <= kAtEnd || s >= lane.line.length() - kAtEnd;
    const bool beyond = at_end && std::abs(dot(off, heading_vector(p.heading))) > kAtEnd;
    out.push_back({norm(off), beyond, lane.at(lane.width_m, s) / 2, lane.at(lane.z, s)});
  }
  return out;
}

}  // namespace infrasim
