#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/data_set.h"
#include "infrasim/io/kitti.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::error_of;
using testing::TestFolder;

ObjectRecord record(int id, const Box3d& box, int points) {
  ObjectRecord o;
  o.id = id;
  o.box = box;
  o.points = points;
  o.points_in_box = points - points / 3;
  o.distance = std::hypot(box.x, box.y);
  o.speed_m_s = 12.5;
  o.visibility = 0.5;
  o.scan_box = box;
  o.scan_box.x += 0.6;
  o.scan_box.heading += 0.01;
  o.scan_time_s = 0.098;
  o.points_in_scan_box = points;
  return o;
}

/// Returns a car 20 m ahead and 3 m to the left. The road is 6 m below the sensor.
ObjectRecord car_ahead(double heading) {
  return record(7, {20, 3, -5.25, 4.5, 1.9, 1.5, heading}, 42);
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) out.push_back(part);
  return out;
}

std::string content(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

Frame small_frame() {
  Frame frame;
  PointCloud& c = frame.cloud;
  c.xyz = {1, 2, 3, -4, 5.5, -6};
  c.intensity = {0.25, 1};
  c.time = {0.0125F, 0.09F};
  c.ring = {3, 65535};
  c.class_id = {0, 10};
  c.object_id = {-1, 7};
  c.echo = {0, 1};
  ObjectRecord hidden = record(9, {50, -3, -5, 6, 2, 2, 0}, 0);
  hidden.object_class = Class::kTruck;
  hidden.visibility = -1;
  frame.objects = {car_ahead(0.3), hidden};
  return frame;
}

// --- labels -----------------------------------------------------------------------------------

/// Returns the numbers of a label, whose columns are: type truncated occluded alpha bbox(4) h w l x
/// y z rotation_y.
std::vector<double> label_numbers(const ObjectRecord& object) {
  std::vector<double> out;
  const auto words = split(split(label_text({object}, true, LabelTime::kFrame), '\n').at(0), ' ');
  EXPECT_EQ(words.size(), 15U);
  for (std::size_t i = 1; i < words.size(); ++i) out.push_back(std::stod(words[i]));
  return out;
}

TEST(label, has_sizes_and_the_bottom_centre_in_camera_axes) {
  const auto n = label_numbers(car_ahead(0));
  const std::vector<double> height_width_length{n[7], n[8], n[9]};
  EXPECT_EQ(height_width_length, (std::vector{1.5, 1.9, 4.5}));
  const std::vector<double> right_down_forward{n[10], n[11], n[12]};
  EXPECT_EQ(right_down_forward, (std::vector{-3.0, 6.0, 20.0}));
}

TEST(label, rotation_y_is_minus_heading_minus_a_quarter_turn) {
  for (const double heading : {0.0, 0.3, -1.2, 3.0, -3.0})
    EXPECT_NEAR(label_numbers(car_ahead(heading))[13], wrap_angle(-heading - kPi / 2), 1e-6);
}

TEST(label, alpha_is_the_rotation_seen_along_the_line_of_sight) {
  // A car that drives straight away from the sensor shows its rear at any position.
  for (const double azimuth : {0.0, 0.5, -1.0, 2.5}) {
    const ObjectRecord away =
        record(1, {20 * std::cos(azimuth), 20 * std::sin(azimuth), -5, 4, 2, 1.5, azimuth}, 1);
    EXPECT_NEAR(label_numbers(away)[2], -kPi / 2, 1e-6) << azimuth;
  }
}

TEST(label, says_how_much_is_hidden) {
  ObjectRecord object = car_ahead(0);
  for (const auto& [visibility, occluded] :
       {std::pair{1.0, 0}, {0.8, 0}, {0.79, 1}, {0.4, 1}, {0.39, 2}, {0.0, 2}, {-1.0, 3}}) {
    object.visibility = visibility;
    EXPECT_EQ(label_numbers(object)[1], occluded) << visibility;
  }
}

TEST(label, is_for_hit_objects_or_for_all) {
  const Frame frame = small_frame();
  const auto hit = split(label_text(frame.objects, false, LabelTime::kFrame), '\n');
  const auto all = split(label_text(frame.objects, true, LabelTime::kFrame), '\n');
  ASSERT_EQ(hit.size(), 1U);
  EXPECT_TRUE(hit[0].starts_with("Car "));
  ASSERT_EQ(all.size(), 2U);
  EXPECT_TRUE(all[1].starts_with("Truck "));
  EXPECT_EQ(label_text({}, true, LabelTime::kFrame), "");
}

TEST(label, has_the_pose_of_the_time_that_is_asked_for) {
  ObjectRecord object = car_ahead(0.3);
  const std::string of_scan = label_text({object}, true, LabelTime::kScan);
  EXPECT_NE(of_scan, label_text({object}, true, LabelTime::kFrame));
  object.box = object.scan_box;
  EXPECT_EQ(of_scan, label_text({object}, true, LabelTime::kFrame));
}

TEST(calibration, takes_a_point_of_the_lidar_to_the_labels_camera) {
  std::vector<double> m;
  for (const std::string& line : split(calib_text(), '\n'))
    if (line.starts_with("Tr_velo_to_cam: "))
      for (const std::string& word : split(line.substr(16), ' ')) m.push_back(std::stod(word));
  ASSERT_EQ(m.size(), 12U);
  const auto n = label_numbers(car_ahead(0.3));
  const Vec3 bottom{20, 3, -6};
  for (std::size_t row = 0; row < 3; ++row)
    EXPECT_NEAR(m[4 * row] * bottom.x + m[4 * row + 1] * bottom.y + m[4 * row + 2] * bottom.z +
                    m[4 * row + 3],
                n[10 + row], 1e-4);
  EXPECT_EQ(split(calib_text(), '\n').size(), 7U);
}

// --- objects ----------------------------------------------------------------------------------

TEST(objects_file, written_and_read_is_the_same) {
  const std::vector<ObjectRecord> objects = small_frame().objects;
  const auto lines = split(objects_csv(objects), '\n');
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(lines[0],
            "id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility,"
            "scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box");
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const ObjectRecord& o = objects[i];
    const auto cells = split(lines[i + 1], ',');
    ASSERT_EQ(cells.size(), 20U);
    EXPECT_EQ(std::stoi(cells[0]), o.id);
    EXPECT_EQ(find_class(cells[1])->id, o.object_class);
    const double values[] = {o.box.x,
                             o.box.y,
                             o.box.z,
                             o.box.dx,
                             o.box.dy,
                             o.box.dz,
                             o.box.heading,
                             o.speed_m_s,
                             static_cast<double>(o.points),
                             static_cast<double>(o.points_in_box),
                             o.distance,
                             o.visibility,
                             o.scan_box.x,
                             o.scan_box.y,
                             o.scan_box.z,
                             o.scan_box.heading,
                             o.scan_time_s,
                             static_cast<double>(o.points_in_scan_box)};
    for (std::size_t c = 0; c < 18; ++c) EXPECT_NEAR(std::stod(cells[c + 2]), values[c], 1e-4);
  }
}

// --- points -----------------------------------------------------------------------------------

TEST(velodyne_file, is_float32_x_y_z_intensity_per_point) {
  const auto bytes = velodyne_bytes(small_frame().cloud);
  ASSERT_EQ(bytes.size(), 32U);
  std::vector<float> values(8);
  std::memcpy(values.data(), bytes.data(), 32);
  EXPECT_EQ(values, (std::vector<float>{1, 2, 3, 0.25, -4, 5.5, -6, 1}));
  EXPECT_TRUE(velodyne_bytes({}).empty());
}

TEST(fields_file, is_12_bytes_of_time_ring_class_echo_and_object_per_point) {
  const auto bytes = fields_bytes(small_frame().cloud);
  ASSERT_EQ(bytes.size(), 24U);
  const auto value = [&]<class T>(std::size_t at, T kind) {
    std::memcpy(&kind, bytes.data() + at, sizeof(T));
    return kind;
  };
  EXPECT_EQ(value(12, float{}), 0.09F);
  EXPECT_EQ(value(16, std::uint16_t{}), 65535);
  EXPECT_EQ(value(18, std::uint8_t{}), 10);
  EXPECT_EQ(value(19, std::uint8_t{}), 1);
  EXPECT_EQ(value(20, std::int32_t{}), 7);
  EXPECT_EQ(value(8, std::int32_t{}), -1);
}

// --- frames on disk ---------------------------------------------------------------------------

TEST(frame_on_disk, has_the_kitti_layout) {
  const TestFolder folder;
  create_frame_folders(folder.path(), true);
  write_frame(folder.path(), 12, small_frame(),
              {.label_time = LabelTime::kScan, .point_fields = true});
  const auto training = folder.path() / "training";
  EXPECT_EQ(velodyne_file(folder.path(), 12), training / "velodyne" / "000012.bin");
  EXPECT_EQ(std::filesystem::file_size(training / "velodyne" / "000012.bin"), 32U);
  EXPECT_EQ(std::filesystem::file_size(training / "fields" / "000012.bin"), 24U);
  EXPECT_EQ(content(training / "label_2" / "000012.txt"),
            label_text(small_frame().objects, false, LabelTime::kScan));
  EXPECT_EQ(content(training / "objects" / "000012.csv"), objects_csv(small_frame().objects));
  EXPECT_EQ(content(training / "calib" / "000012.txt"), calib_text());
}

TEST(frame_on_disk, counts_what_the_frame_had) {
  const TestFolder folder;
  create_frame_folders(folder.path(), false);
  write_frame(folder.path(), 0, small_frame(), {});
  const FrameCounts before = count(small_frame()), after = read_counts(folder.path(), 0);
  EXPECT_EQ(after.hits, 2U);
  EXPECT_EQ(after.hits, before.hits);
  EXPECT_EQ(after.vehicles, before.vehicles);
  EXPECT_EQ(after.vehicle_points, before.vehicle_points);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "training" / "fields"));
}

TEST(frame_on_disk, people_are_not_counted_as_vehicles) {
  Frame frame = small_frame();
  const FrameCounts vehicles = count(frame);
  for (const Class person : {Class::kPedestrian, Class::kCyclist}) {
    ObjectRecord one = frame.objects.front();
    one.id = static_cast<int>(person);
    one.object_class = person;
    one.points = 1000;
    frame.objects.push_back(one);
  }
  const TestFolder folder;
  create_frame_folders(folder.path(), false);
  write_frame(folder.path(), 0, frame, {});
  for (const FrameCounts& counts : {count(frame), read_counts(folder.path(), 0)}) {
    EXPECT_EQ(counts.vehicles, vehicles.vehicles);
    EXPECT_EQ(counts.vehicle_points, vehicles.vehicle_points);
  }
}

TEST(frame_on_disk, that_is_missing_or_cut_off_is_an_error) {
  const TestFolder folder;
  create_frame_folders(folder.path(), false);
  error_of<IoError>([&] { read_counts(folder.path(), 0); });
  write_frame(folder.path(), 0, small_frame(), {});
  const auto file = folder.write("training/objects/000000.csv", "id,class\n7,Car,1,2\n");
  testing::expect_message(error_of([&] { read_counts(folder.path(), 0); }), file, 1, "(header)",
                          ", got 'id,class'");
  const std::string text = objects_csv(small_frame().objects);
  folder.write("training/objects/000000.csv", text.substr(0, text.size() - 20));
  testing::expect_message(error_of([&] { read_counts(folder.path(), 0); }), file, 3, "(row)",
                          "expected 20 columns");
}

TEST(file_written_in_pieces, is_there_as_a_whole_or_not_at_all) {
  const TestFolder folder;
  const auto file = folder.path() / "a.txt";
  {
    AtomicFile left(file);
    left.write("half");
    EXPECT_FALSE(std::filesystem::exists(file));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  AtomicFile out(file);
  out.write("one ");
  out.write("two");
  out.replace();
  EXPECT_EQ(content(file), "one two");
}

TEST(file_written_at_once, replaces_the_old_one_and_leaves_nothing_else) {
  const TestFolder folder;
  write_file_atomically(folder.path() / "a.txt", "old");
  write_file_atomically(folder.path() / "a.txt", "new");
  EXPECT_EQ(content(folder.path() / "a.txt"), "new");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(file_written_at_once, in_a_folder_that_is_missing_is_an_error_that_names_it) {
  const TestFolder folder;
  const auto file = folder.path() / "missing" / "a.txt";
  const std::string message = error_of<IoError>([&] { write_file_atomically(file, "text"); });
  EXPECT_TRUE(message.starts_with(file.string())) << message;
  EXPECT_NE(message.find("No such file"), std::string::npos) << message;
}

TEST(file_written_at_once, in_place_of_a_folder_is_an_error_and_leaves_nothing_else) {
  const TestFolder folder;
  std::filesystem::create_directory(folder.path() / "a");
  error_of<IoError>([&] { write_file_atomically(folder.path() / "a", "text"); });
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(claim, of_a_folder_with_the_same_text_is_fine) {
  const TestFolder folder;
  const auto file = folder.path() / "dataset.yaml";
  claim_file(file, "name: a\nseed: 1\n");
  EXPECT_NO_THROW(claim_file(file, "name: a\nseed: 1\n"));
  EXPECT_EQ(content(file), "name: a\nseed: 1\n");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(claim, of_a_folder_with_another_text_is_an_error_that_names_the_line) {
  const TestFolder folder;
  const auto file = folder.path() / "dataset.yaml";
  claim_file(file, "name: a\nseed: 1\n");
  const std::string message = error_of<IoError>([&] { claim_file(file, "name: a\nseed: 2\n"); });
  EXPECT_TRUE(message.starts_with(file.string() + ":2:")) << message;
  EXPECT_NE(message.find("seed: 1"), std::string::npos) << message;
  EXPECT_NE(message.find("seed: 2"), std::string::npos) << message;
  const std::string shorter = error_of<IoError>([&] { claim_file(file, "name: a\n"); });
  EXPECT_TRUE(shorter.starts_with(file.string() + ":2:")) << shorter;
  EXPECT_EQ(content(file), "name: a\nseed: 1\n");
}

}  // namespace
}  // namespace infrasim
