#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/sensor/prisms.h"

namespace infrasim {

/// Consecutive rays, numbered from the start of the run.
struct RayRange {
  std::int64_t first = 0;
  std::int64_t last = 0;  ///< number of the ray after the last one
  std::int64_t size() const { return last - first; }
};

/// One ray: unit direction in the unit's own frame, and firing time since the start of the run.
struct Ray {
  Vec3 direction;
  double time_s = 0;
};

/// Directions and times of the rays of one optical unit. Rays are fired in groups. A group is a
/// column of channels, the lasers of one step, or one row of a table. If some channels do not fire
/// in every column, a group is the shortest run of columns after which the same channels fire
/// again. Groups are numbered from the start of the run. A pattern does not restart at the
/// beginning of a frame.
class ScanPattern {
 public:
  /// @param phase_s   time by which the motors are ahead of their locked phase
  /// @param unit_pose rotation from the unit's frame to the levelled frame
  /// @param first_ring ring number of the unit's lowest laser
  ScanPattern(const PatternConfig& config, double phase_s, const Mat3& unit_pose, int first_ring);

  int group_size() const { return group_size_; }
  /// Returns the number of rings: the number of channels of a spinning unit, the number of lasers
  /// of a unit with prisms, or 1 for a table.
  int rings() const { return rings_; }
  double groups_per_s() const { return groups_per_s_; }
  bool spins() const;
  /// Returns the time in which a pattern covers the whole field of view; 1 s for prisms, which
  /// never repeat.
  double cycle_s() const;

  /// Returns the number of groups after which `generate` gives the same directions again, bit for
  /// bit. The number is 0 for patterns that never repeat: prisms, and columns whose step is not a
  /// short fraction of a turn.
  std::int64_t repeats_after() const;

  /// Returns the rays of all groups that start at `from_s` or later and before `to_s`.
  RayRange fired_between(double from_s, double to_s) const;

  /// Returns the ray with number `index`, computed in double precision.
  Ray ray(std::int64_t index) const;

  /// Generates the rays of whole groups, one after the other, in the levelled frame. The times are
  /// relative to `start_s`.
  void generate(RayRange range, double start_s, RayBatch& rays) const;

  /// Generates selected rays of a batch. The batch's `number` counts from the first ray of group
  /// `first_group`.
  /// @param which positions in the batch, ascending; the other positions do not change
  void generate(std::int64_t first_group, double start_s, std::span<const std::uint32_t> which,
                RayBatch& rays) const;

  /// Sets the ring of each ray of a batch. The rays need not have directions.
  void set_rings(RayBatch& rays) const;

  /// Returns the rays of `groups` groups in an order in which neighbouring rays are close together.
  /// For a spinning unit, the order goes through tiles of 4 columns by 4 neighbouring rings.
  std::vector<std::uint32_t> tile_order(int groups) const;

 private:
  void generate_columns(std::int64_t first_group, double start_s,
                        std::span<const std::uint32_t> which, RayBatch& rays) const;
  void generate_steps(std::int64_t first_group, double start_s,
                      std::span<const std::uint32_t> which, RayBatch& rays) const;
  void put(std::size_t k, Vec3 direction, double time_s, int member, RayBatch& rays) const;
  void add_lasers();
  double group_deg(std::int64_t group) const;
  std::pair<float, float> turn(std::int64_t group) const;
  double optical_time(std::int64_t group) const;
  Ray spinning_ray(std::int64_t group, int member) const;
  Ray prism_ray(std::int64_t group, int member) const;
  Ray table_ray(std::int64_t group) const;
  double table_time(std::int64_t row) const;

  PatternConfig config_;
  double phase_s_;
  /// number of groups per turn of a spinning unit, if it is an exact fraction
  std::optional<Fraction> groups_per_turn_;
  double start_deg_ = 0;  ///< angle between a spinning unit's x axis and its direction at time 0
  std::array<float, 9> pose_;
  Mat3 pose_exact_;
  int group_size_ = 1;
  int rings_ = 1;
  double groups_per_s_ = 0;
  std::int64_t first_row_ = 0;                  ///< row of a table at time 0
  std::vector<std::uint16_t> ring_;             ///< ring of each member of a group
  std::vector<std::uint32_t> members_by_ring_;  ///< members of a group from the lowest ring up
  struct Laser {
    float cos_elevation, sin_elevation, cos_shift, sin_shift, fire_time;
  };
  std::vector<Laser> lasers_;  ///< lasers of a group of a spinning unit
  struct Shot {
    std::uint32_t channel;
    /// shift_deg is the azimuth offset in the direction of rotation
    double elevation_deg, shift_deg;
    double fire_time_s;  ///< firing time after the start of the group
  };
  std::vector<Shot> shots_;  ///< `lasers_` in double precision
  /// result of `turn` for each group of a period; empty if the pattern has no period or too many
  /// groups
  std::vector<std::pair<float, float>> turns_;
  DirectionBatch lasers_of_step_;                 ///< directions of the lasers before the prisms
  std::vector<std::pair<double, double>> tilts_;  ///< cosine and sine of the prisms' wedge angles
};

/// Returns the channels of a spinning unit from the lowest ring up. Channels of the same elevation
/// keep their order.
std::vector<Channel> channels_by_ring(const SpinningConfig& spinning);

}  // namespace infrasim
