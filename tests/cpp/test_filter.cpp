#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "filter_scenes.h"
#include "infrasim/core/errors.h"
#include "infrasim/filter/filter.h"

namespace infrasim {
namespace {

using testing::cast;
using testing::LabelledCloud;
using testing::rosette_directions;
using testing::Scene;
using testing::spinning_directions;
using testing::traffic;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kFloatInf = std::numeric_limits<float>::infinity();
using Indices = std::vector<int>;

/// Percentage of the vehicle points 0.3 m or more above the road that the filter keeps, and
/// percentage of the ground points that the filter removes.
struct Score {
  double vehicles_kept;
  double ground_removed;
};

Score score(const LabelledCloud& cloud, const Indices& kept) {
  double vehicles = 0, ground = 0, vehicles_kept = 0, ground_kept = 0;
  std::vector<char> is_kept(cloud.size());
  for (const int i : kept) is_kept[i] = 1;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.object[i] == -1) ground += 1, ground_kept += is_kept[i];
    if (cloud.object[i] >= 0 && cloud.above_road_m[i] > 0.3)
      vehicles += 1, vehicles_kept += is_kept[i];
  }
  EXPECT_GT(vehicles, 500);
  EXPECT_GT(ground, 5000);
  return {100 * vehicles_kept / vehicles, 100 - 100 * ground_kept / ground};
}

void expect_targets(const Score& s) {
  EXPECT_GE(s.vehicles_kept, 99);
  EXPECT_GE(s.ground_removed, 98);
}

constexpr double kEightLanes[] = {4, 7.5, 11, 14.5, -4, -7.5, -11, -14.5};
constexpr double kFiveLanes[] = {-16, -12.5, -9, -5.5, -2};
constexpr double kTwoLanes[] = {-4.5, -1};

Scene flat_road(double grade = 0) {
  return {{{-200, -6}, {200, -6}}, grade, traffic(kEightLanes, 18, 0, grade), {}};
}

/// Returns a road on an embankment of 8 m height with slopes of 1:1.5. The LiDAR is 3 m from the
/// edge.
Scene bank() {
  return {{{-200, -14}, {-35, -14}, {-20, -6}, {3, -6}, {15, -14}, {200, -14}},
          0,
          traffic(kFiveLanes, 18, 0),
          {}};
}

/// Returns a road of 42 m width. The LiDAR is above its middle.
Scene wide_bank() {
  return {{{-200, -14}, {-37, -14}, {-21, -6}, {21, -6}, {37, -14}, {200, -14}},
          0,
          traffic(kEightLanes, 18, 0),
          {}};
}

/// Returns a road of 10.5 m width with slopes of 1:3.
Scene narrow_bank() {
  return {{{-200, -14}, {-32, -14}, {-8, -6}, {2.5, -6}, {26.5, -14}, {200, -14}},
          0,
          traffic(kTwoLanes, 25, 0),
          {}};
}

std::vector<FilterStep> one_of_each() {
  const std::vector<std::vector<float>> frames = {{10, 0, -6, 10, 1, -6}};
  return {CropBox{{-100, -100, -100}, {100, 100, 100}},
          CropPolygon{{{-50, -50}, {50, -50}, {50, 50}, {-50, 50}}},
          CropRange{0, 100},
          CropFieldOfView{},
          GroundHeight{-5},
          GroundPlane{},
          GroundMorphological{},
          learn_background(frames)};
}

TEST(filter, no_step_keeps_nan_or_infinite_points) {
  const std::vector<float> xyz = {kNan, 0,         0, 0, kNan, 0, 5,         5,
                                  kNan, kFloatInf, 0, 0, 0,    0, -kFloatInf};
  for (const FilterStep& step : one_of_each())
    EXPECT_EQ(infrasim::apply(step, xyz), Indices{}) << "step " << step.index();
  EXPECT_EQ(keep_all({}, xyz), Indices{});
}

/// Returns the cloud with three points at 0 0 0 inserted before each point. Some drivers write such
/// a point for a ray without a return.
std::vector<float> with_rays_without_return(const std::vector<float>& xyz) {
  std::vector<float> out;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    out.insert(out.end(), 9, 0);
    out.insert(out.end(), {xyz[i], xyz[i + 1], xyz[i + 2]});
  }
  return out;
}

TEST(filter, rays_without_a_return_change_nothing) {
  const std::vector<float> xyz = cast(flat_road(), spinning_directions(), 0, 100).xyz;
  const std::vector<float> all_rays = with_rays_without_return(xyz);
  const std::vector<float> frames[] = {xyz}, frames_of_all_rays[] = {all_rays};
  EXPECT_EQ(background_to_bytes(learn_background(frames_of_all_rays)),
            background_to_bytes(learn_background(frames)));
  std::vector<FilterStep> steps = one_of_each();
  steps.emplace_back(GroundPlane{.sensor_height_m = 6});
  for (const FilterStep& step : steps) {
    Indices expected = keep_all(std::span(&step, 1), xyz);
    for (int& i : expected) i = 4 * i + 3;
    EXPECT_EQ(keep_all(std::span(&step, 1), all_rays), expected) << "step " << step.index();
  }
}

TEST(filter, every_step_keeps_nothing_of_an_empty_cloud) {
  for (const FilterStep& step : one_of_each()) EXPECT_TRUE(apply(step, {}).empty());
}

TEST(filter, steps_narrow_down_one_after_another) {
  const std::vector<float> xyz = {1, 0, 0, 9, 0, 0, kNan, 0, 0, 4, 0, -6, 4, 0, 0};
  const std::vector<FilterStep> steps = {CropRange{2, 20}, GroundHeight{-5},
                                         CropBox{{0, -1, -1}, {5, 1, 1}}};
  EXPECT_EQ(keep_all(std::span(steps).first(1), xyz), (Indices{1, 3, 4}));
  EXPECT_EQ(keep_all(std::span(steps).first(2), xyz), (Indices{1, 4}));
  EXPECT_EQ(keep_all(steps, xyz), (Indices{4}));
  EXPECT_EQ(keep_all({}, xyz), (Indices{0, 1, 3, 4}));
}

TEST(crop, box_keeps_points_inside_and_on_its_faces) {
  const std::vector<float> xyz = {0, 0, 1, 1, 2, 3, 1.01F, 0, 1, 0, -0.01F, 1, 0, 0, 3.01F};
  EXPECT_EQ(keep(xyz, CropBox{{0, 0, 1}, {1, 2, 3}}), (Indices{0, 1}));
}

TEST(crop, polygon_keeps_what_lies_inside_in_either_direction_of_turn) {
  CropPolygon ell{{{0, 0}, {4, 0}, {4, 2}, {2, 2}, {2, 4}, {0, 4}}};
  const std::vector<float> xyz = {1, 1, 9, 3, 1, -9, 1, 3, 0, 3, 3, 0, -1, 1, 0, 5, 1, 0};
  EXPECT_EQ(keep(xyz, ell), (Indices{0, 1, 2}));
  std::ranges::reverse(ell.outline_m);
  EXPECT_EQ(keep(xyz, ell), (Indices{0, 1, 2}));
}

TEST(crop, range_is_the_slant_range) {
  const std::vector<float> xyz = {3, 0, 4, 3, 0, 0, 0, 0, -6};
  EXPECT_EQ(keep(xyz, CropRange{5, 6}), (Indices{0, 2}));
}

TEST(crop, field_of_view_may_go_through_180_degrees) {
  const std::vector<float> xyz = {-1, 0.1F, 0, -1, -0.1F, 0, 1, 0, 0, 0, 1, 0, -1, 0, 1};
  EXPECT_EQ(keep(xyz, CropFieldOfView{170, -170, -10, 10}), (Indices{0, 1}));
  EXPECT_EQ(keep(xyz, CropFieldOfView{-170, 170, -10, 10}), (Indices{2, 3}));
  EXPECT_EQ(keep(xyz, CropFieldOfView{-180, 180, 40, 50}), (Indices{4}));
}

TEST(crop, crossed_bounds_and_lines_are_errors) {
  EXPECT_THROW(keep({}, CropBox{{0, 1, 0}, {1, 0, 1}}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropBox{{0, kNan, 0}, {1, 1, 1}}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropRange{2, 1}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropFieldOfView{0, 200, -1, 1}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropFieldOfView{0, 1, 1, -1}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropPolygon{{{0, 0}, {1, 1}}}), std::invalid_argument);
  EXPECT_THROW(keep({}, CropPolygon{{{0, 0}, {1, 1}, {2, 2}}}), std::invalid_argument);
}

TEST(ground, height_filter_keeps_points_above_the_road) {
  const std::vector<float> xyz = {9, 0, -6, 9, 0, -5.5F, 9, 0, -5.49F};
  EXPECT_EQ(keep(xyz, GroundHeight{-5.5}), (Indices{2}));
}

TEST(ground, plane_filter_keeps_points_above_threshold) {
  std::vector<float> xyz;
  for (int x = 0; x < 20; ++x)
    for (int y = 0; y < 20; ++y)
      xyz.insert(xyz.end(), {static_cast<float>(x), static_cast<float>(y), -6});
  xyz.insert(xyz.end(), {5.5F, 5.5F, -5.7F, 5.5F, 5.5F, -5.8F});
  EXPECT_EQ(keep(xyz, GroundPlane{.distance_m = 0.25, .max_tilt_deg = 10}), (Indices{400}));
}

TEST(ground, plane_filter_keeps_a_cloud_without_level_surface) {
  std::vector<float> wall;
  for (int y = 0; y < 20; ++y)
    for (int z = 0; z < 20; ++z)
      wall.insert(wall.end(), {20, static_cast<float>(y), static_cast<float>(z)});
  EXPECT_EQ(keep(wall, GroundPlane{}).size(), 400U);
  EXPECT_EQ(keep(std::vector<float>{1, 2, 3}, GroundPlane{}), (Indices{0}));
}

TEST(ground, plane_filter_reaches_the_targets_on_a_road_with_a_grade) {
  for (const double grade : {0.0, 0.04}) {
    const LabelledCloud cloud = cast(flat_road(grade), spinning_directions(), 0, 100);
    expect_targets(score(cloud, keep(cloud.xyz, GroundPlane{})));
  }
}

TEST(ground, plane_filter_is_the_same_every_time) {
  const LabelledCloud cloud = cast(bank(), spinning_directions(), 0, 100);
  EXPECT_EQ(keep(cloud.xyz, GroundPlane{}), keep(cloud.xyz, GroundPlane{}));
}

TEST(ground, plane_filter_removes_only_one_plane_of_a_bank) {
  const LabelledCloud cloud = cast(wide_bank(), spinning_directions(), 0, 100);
  const Indices kept = keep(cloud.xyz, GroundPlane{});
  EXPECT_LT(score(cloud, kept).ground_removed, 90);
  for (const int i : kept)
    EXPECT_TRUE(cloud.object[i] != -1 || cloud.above_road_m[i] < -0.1) << "a point of the road";
}

/// Returns a road 6 m below the LiDAR, and a wider field beside it. The plane of the field has more
/// points.
Scene road_and_field(double field_z) {
  return {
      {{-120, field_z}, {-5, field_z}, {-4, -6}, {4, -6}, {5, field_z}, {120, field_z}}, 0, {}, {}};
}

TEST(ground, plane_filter_takes_the_plane_that_lies_where_the_ground_should) {
  for (const double field_z : {-8.0, -6.4, -5.0}) {
    const LabelledCloud cloud = cast(road_and_field(field_z), spinning_directions(), 0, 100);
    for (const bool known : {false, true}) {
      const auto kept = keep(cloud.xyz, GroundPlane{.sensor_height_m = known ? 6.0 : 0.0});
      const auto road =
          std::ranges::count_if(kept, [&](int i) { return std::abs(cloud.above_road_m[i]) < 0.1; });
      EXPECT_EQ(road < 10, known) << "field at " << field_z << " m, " << road << " points of road";
    }
  }
}

TEST(ground, plane_filter_keeps_every_point_where_no_plane_is_the_ground) {
  const LabelledCloud cloud = cast(road_and_field(-8), spinning_directions(), 0, 100);
  EXPECT_EQ(keep(cloud.xyz, GroundPlane{.sensor_height_m = 3}).size(), cloud.size());
  std::size_t calls = 0;
  const std::vector<FilterStep> steps{GroundPlane{.sensor_height_m = 3}, GroundPlane{}};
  keep_all(steps, cloud.xyz, [&](const FilterStep& step, std::size_t before, std::size_t after) {
    ++calls;
    EXPECT_EQ(before == after, std::get<GroundPlane>(step).sensor_height_m == 3);
  });
  EXPECT_EQ(calls, 2U);
}

void expect_targets_of_morphological(const Scene& scene) {
  const LabelledCloud cloud = cast(scene, spinning_directions(), 0, 100);
  expect_targets(score(cloud, keep(cloud.xyz, GroundMorphological{})));
}

TEST(ground, morphological_filter_reaches_the_targets_on_a_bank) {
  expect_targets_of_morphological(bank());
}

TEST(ground, nightly_morphological_filter_reaches_the_targets_on_roads_and_other_banks) {
  for (const Scene& scene : {flat_road(), flat_road(0.04), wide_bank(), narrow_bank()})
    expect_targets_of_morphological(scene);
}

TEST(ground, morphological_filter_removes_the_ground_of_a_pattern_without_rings) {
  // A frame keeps 94 to 100 % of the points, because the edge of the field of view cuts some
  // vehicles.
  constexpr int kFrames = 10;
  Score mean{};
  for (int k = 0; k < kFrames; ++k) {
    const LabelledCloud cloud = cast(bank(), rosette_directions(k), k, 200);
    const Score s = score(cloud, keep(cloud.xyz, GroundMorphological{}));
    mean.vehicles_kept += s.vehicles_kept / kFrames;
    mean.ground_removed += s.ground_removed / kFrames;
  }
  expect_targets(mean);
}

TEST(ground, morphological_filter_keeps_points_beyond_its_range) {
  const std::vector<float> xyz = {9, 0, -6, 60, 0, -6};
  EXPECT_EQ(keep(xyz, GroundMorphological{.max_range_m = 50}), (Indices{1}));
}

TEST(ground, parameters_out_of_range_are_errors) {
  EXPECT_THROW(keep({}, GroundHeight{kNan}), std::invalid_argument);
  EXPECT_THROW(keep({}, GroundPlane{.distance_m = 0}), std::invalid_argument);
  EXPECT_THROW(keep({}, GroundPlane{.max_tilt_deg = 90}), std::invalid_argument);
  EXPECT_THROW(keep({}, GroundMorphological{.window_m = kNan}), std::invalid_argument);
  EXPECT_THROW(keep({}, GroundMorphological{.cell_m = 0}), std::invalid_argument);
  EXPECT_THROW(keep({}, GroundMorphological{.cell_m = 0.1}), std::invalid_argument);
}

std::vector<Vec3> ahead() {
  std::vector<Vec3> out = spinning_directions();
  std::erase_if(out, [](Vec3 u) { return std::abs(std::atan2(u.y, u.x)) > rad(30); });
  return out;
}

/// Learns the background from frames with moving traffic of 25 vehicles per km and lane, filters a
/// later frame, and returns the score of that frame.
template <class Directions>
Score learn_and_filter(Scene scene, std::span<const double> lanes_y, int frames, double max_range_m,
                       Directions directions) {
  const auto frame = [&](int k) {
    scene.vehicles = traffic(lanes_y, 40, 7.3 * k);
    return cast(scene, directions(k), k, max_range_m);
  };
  std::vector<std::vector<float>> learned;
  for (int k = 0; k < frames; ++k) learned.push_back(frame(k).xyz);
  const LabelledCloud cloud = frame(1000);
  return score(cloud, keep(cloud.xyz, learn_background(learned)));
}

TEST(background, nightly_model_of_a_turning_sensor_reaches_the_targets) {
  const auto directions = [ahead = ahead()](int) { return ahead; };
  expect_targets(learn_and_filter(flat_road(), kEightLanes, 40, 100, directions));
  expect_targets(learn_and_filter(bank(), kFiveLanes, 40, 100, directions));
}

TEST(background, nightly_model_of_a_pattern_that_never_repeats_reaches_the_targets) {
  expect_targets(learn_and_filter(flat_road(), kEightLanes, 100, 200,
                                  [](int k) { return rosette_directions(13 * k); }));
}

TEST(background, buildings_are_removed_and_a_vehicle_before_them_is_kept) {
  Scene scene = flat_road();
  scene.vehicles.clear();
  scene.buildings = {{40, 0, -1, 4, 40, 10, 0}};
  const std::vector<Vec3> directions = ahead();
  std::vector<std::vector<float>> frames;
  for (int i = 0; i < 5; ++i) frames.push_back(cast(scene, directions, i, 100).xyz);
  scene.vehicles = {{35, 0, -5.25, 4.5, 1.8, 1.5, 0}};
  const LabelledCloud cloud = cast(scene, directions, 99, 100);
  int kept[2] = {}, all[2] = {};
  std::vector<char> is_kept(cloud.size());
  for (const int i : keep(cloud.xyz, learn_background(frames))) is_kept[i] = 1;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.object[i] == 0 && cloud.above_road_m[i] < 0.3) continue;
    ++all[cloud.object[i] == 0];
    kept[cloud.object[i] == 0] += is_kept[i];
  }
  EXPECT_LT(kept[0], all[0] / 50);
  EXPECT_EQ(kept[1], all[1]);
  EXPECT_GT(all[1], 50);
}

TEST(background, a_queue_that_hides_the_road_in_most_frames_is_not_background) {
  Scene empty = flat_road(), queue = flat_road();
  empty.vehicles.clear();
  queue.vehicles = {{20, 4, -5.25, 4.5, 1.8, 1.5, 0}};
  const std::vector<Vec3> directions = ahead();
  std::vector<std::vector<float>> frames;
  for (int i = 0; i < 20; ++i)
    frames.push_back(cast(i % 5 == 0 ? empty : queue, directions, i, 60).xyz);
  const LabelledCloud cloud = cast(queue, directions, 99, 60);
  EXPECT_GE(score(cloud, keep(cloud.xyz, learn_background(frames))).vehicles_kept, 99);
}

TEST(background, what_appears_where_nothing_was_ever_seen_is_kept) {
  const std::vector<std::vector<float>> frames = {{10, 0, -6, 10, 0.1F, -6}};
  const BackgroundModel model = learn_background(frames);
  EXPECT_EQ(keep(std::vector<float>{10, 0, 3, 10, 0, -6, 5, 0, -3, 20, 0, -12}, model),
            (Indices{0, 2}));
}

/// Returns a model with few cells, which is learnt from one ring of ground points.
BackgroundModel coarse_model() {
  std::vector<std::vector<float>> frames(1);
  for (int i = 0; i < 360; ++i) {
    const Vec3 p = 10.0 * testing::direction(rad(i), rad(-30));
    for (const double v : {p.x, p.y, p.z}) frames[0].push_back(static_cast<float>(v));
  }
  return learn_background(frames, {.azimuth_cell_deg = 10, .elevation_cell_deg = 10});
}

TEST(background, a_saved_model_loads_as_it_was) {
  const BackgroundModel model = coarse_model();
  const std::string bytes = background_to_bytes(model);
  EXPECT_TRUE(is_background(bytes));
  const BackgroundModel loaded = background_from_bytes(bytes, "model");
  EXPECT_EQ(loaded.azimuth_cells, model.azimuth_cells);
  EXPECT_EQ(loaded.elevation_cells, model.elevation_cells);
  EXPECT_EQ(loaded.range_m, model.range_m);
  EXPECT_EQ(loaded.height_m, model.height_m);
  EXPECT_EQ(background_to_bytes(loaded), bytes);
}

TEST(background, a_model_that_saw_nothing_is_saved_too) {
  const std::vector<std::vector<float>> frames(1);
  const BackgroundModel model = learn_background(frames);
  const BackgroundModel loaded = background_from_bytes(background_to_bytes(model), "model");
  EXPECT_EQ(loaded.range_m, model.range_m);
}

TEST(background, a_broken_model_file_is_an_error) {
  const std::string bytes = background_to_bytes(coarse_model());
  for (std::size_t n = 0; n < bytes.size(); ++n)
    EXPECT_THROW(background_from_bytes(bytes.substr(0, n), "model"), ConfigError);
  EXPECT_THROW(background_from_bytes(bytes + "x", "model"), ConfigError);
  for (const std::size_t byte : {0, 22, 30, 34, 37}) {
    std::string broken = bytes;
    broken[byte] = static_cast<char>(broken[byte] ^ 0x40);
    EXPECT_THROW(background_from_bytes(broken, "model"), ConfigError) << "byte " << byte;
  }
  std::string nan = bytes;
  nan.replace(nan.size() - 4, 4, "\xff\xff\xff\xff");
  EXPECT_THROW(background_from_bytes(nan, "model"), ConfigError);
}

TEST(background, parameters_out_of_range_are_errors) {
  const std::vector<std::vector<float>> frames(1);
  EXPECT_THROW(learn_background({}), std::invalid_argument);
  EXPECT_THROW(learn_background(frames, {.azimuth_cell_deg = 0}), std::invalid_argument);
  EXPECT_THROW(learn_background(frames, {.range_margin_m = -1}), std::invalid_argument);
}

}  // namespace
}  // namespace infrasim
