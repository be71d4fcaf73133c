#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"

namespace infrasim {

/// A range of rays by their number since the start of the run.
struct RayRange {
  std::int64_t first = 0;
  std::int64_t last = 0;  ///< one past the end
  std::int64_t size() const { return last - first; }
};

/// One ray: unit direction in the unit's own frame, and firing time since the start of the run.
struct Ray {
  Vec3 direction;
  double time_s = 0;
};

/// Directions of all lasers of a step, one column for each component: loops over them become
/// vector code.
struct DirectionBatch {
  std::vector<double> x, y, z;
};

/// Directions and times of one optical unit. Rays are fired in groups (a column of channels, the
/// lasers of one step, one row of a table), numbered for ever from the start of the run: a pattern
/// never restarts at a frame.
class ScanPattern {
 public:
  /// @param phase_s   time by which the motors are ahead of where a lock would hold them
  /// @param unit_pose rotation from the unit's frame to the levelled frame
  /// @param first_ring ring number of the unit's lowest laser
  ScanPattern(const PatternConfig& config, double phase_s, const Mat3& unit_pose, int first_ring);

  int group_size() const { return group_size_; }
  double groups_per_s() const { return groups_per_s_; }
  bool spins() const;
  double cycle_s() const;  ///< in which it looks everywhere; 1 s for prisms, which never repeat

  /// Groups after which `generate` gives the same directions again, bit for bit; 0 if never: of
  /// prisms, and of columns whose step no short fraction of a turn gives.
  std::int64_t repeats_after() const;

  /// Whole groups that start in [from, to) seconds.
  RayRange fired_between(double from_s, double to_s) const;

  /// One ray in double precision.
  Ray ray(std::int64_t index) const;

  /// Rays of whole groups, one after the other, in the levelled frame; times since `start_s`.
  void generate(RayRange range, double start_s, RayBatch& rays) const;

  /// An order in which rays of that many groups are near each other: tiles of 4 columns by 4
  /// neighbouring rings for a spinning unit.
  std::vector<std::uint32_t> tile_order(int groups) const;

 private:
  void generate_columns(std::int64_t first_group, std::int64_t last_group, double start_s,
                        RayBatch& rays) const;
  void generate_steps(std::int64_t first_group, std::int64_t last_group, double start_s,
                      RayBatch& rays) const;
  void put(std::size_t k, Vec3 direction, double time_s, int member, RayBatch& rays) const;
  double column_deg(std::int64_t column) const;
  double optical_time(std::int64_t group) const;
  Ray spinning_ray(std::int64_t group, int member) const;
  Ray prism_ray(std::int64_t group, int member) const;
  Ray table_ray(std::int64_t group) const;
  double table_time(std::int64_t row) const;

  PatternConfig config_;
  double phase_s_;
  std::optional<Fraction> columns_per_turn_;  ///< of a spinning unit, if it is exact
  double start_deg_ = 0;  ///< how far a spinning unit has turned from its x axis at time 0
  std::array<float, 9> pose_;
  Mat3 pose_exact_;
  int group_size_ = 1;
  double groups_per_s_ = 0;
  std::int64_t first_row_ = 0;                 ///< of a table, at time 0
  std::vector<std::uint16_t> ring_;            ///< of each member of a group
  std::vector<std::uint32_t> member_of_ring_;  ///< its inverse
  struct Laser {
    float cos_elevation, sin_elevation, cos_shift, sin_shift, fire_time;
  };
  std::vector<Laser> lasers_;      ///< of a spinning unit
  DirectionBatch lasers_of_step_;  ///< before the prisms
};

/// Extent of a pattern in its own frame.
struct FieldOfView {
  double azimuth_min_deg, azimuth_max_deg, elevation_min_deg, elevation_max_deg;
};

/// Smallest box around all directions of one second.
FieldOfView field_of_view(const ScanPattern& pattern);

}  // namespace infrasim
