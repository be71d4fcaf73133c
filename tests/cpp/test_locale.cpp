#include <gtest/gtest.h>
#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): setenv is POSIX

#include <array>
#include <clocale>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <locale>
#include <stdexcept>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/run_folder.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

class DecimalComma : public std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

/// Sets a locale with a decimal comma for the process, as Python may do.
class CommaLocale {
 public:
  CommaLocale()
      : streams_before_(
            std::locale::global(std::locale(std::locale::classic(), new DecimalComma))) {
    const std::string from = INFRASIM_SOURCE_DIR "/tests/data/locale/";
    const std::string folder = folder_.path().string();
    // The program warns of categories that are missing in the source, and then exits with 1.
    const std::string command = "localedef -c --no-archive -f " + from + "ascii -i " + from +
                                "decimal_comma " + folder + "/comma 2> " + folder + "/log";
    if (std::system(command.c_str()) < 0) throw std::runtime_error("no shell");
    ::setenv("LOCPATH", folder.c_str(), 1);
    set_ = std::setlocale(LC_NUMERIC, "comma") != nullptr;
  }
  ~CommaLocale() {
    std::setlocale(LC_NUMERIC, "C");
    ::unsetenv("LOCPATH");
    std::locale::global(streams_before_);
  }
  CommaLocale(const CommaLocale&) = delete;
  CommaLocale& operator=(const CommaLocale&) = delete;

  bool is_set() const { return set_; }

 private:
  testing::TestFolder folder_;
  std::locale streams_before_;
  bool set_ = false;
};

std::string printed(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.1f", value);
  return text.data();
}

/// Returns all texts that the simulator writes, and the values that it reads from them.
std::vector<std::string> texts() {
  const testing::TestFolder folder;
  SceneConfig scene = testing::empty_road();
  scene.traffic->vehicles_per_km_lane = 15;
  scene.mounts["pole"].yaw_deg = 12.5;
  RegionConfig region;
  region.name = "here";
  region.outline_m = {{-1000.5, -50}, {1000.5, -50}, {1000.5, 50}};
  scene.regions = {region};
  const World world = build_world(scene);
  const LidarConfig lidar = read_lidar(testing::configs() / "lidars/helios_16.yaml", "datasheet");
  ObjectRecord object;
  object.box = {
      .x = 1234.5, .y = -0.25, .z = -5.5, .dx = 4.5, .dy = 1.9, .dz = 1.5, .heading = 0.1};
  object.points = object.points_in_box = 1234;
  object.visibility = 0.5;
  const std::string trajectories = trajectories_csv(*world.trajectories);
  const auto file = folder.write("trajectories.csv", trajectories);
  const auto refused = [&](const auto& action) {
    const std::string message = testing::error_of(action);
    return message.substr(folder.path().string().size());
  };
  return {
      label_text({object}, true, LabelTime::kFrame),
      objects_csv({object}, true),
      calib_text(),
      frame_name(1234),
      world.region.roads_csv(),
      world.region.regions_csv(),
      trajectories,
      trajectories_csv(read_trajectories(file)),
      dump_scene(parse_scene(dump_scene(scene), "scene")),
      lidar_yaml(world, lidar),
      refused([&] {
        read_trajectories(folder.write("wrong.csv",
                                       "t,id,class,x,y,z,heading,dx,dy,dz,speed\n"
                                       "0,1,Car,1e8,2,0.75,0,4.5,1.9,1.5,10\n"));
      }),
      refused([&] {
        SceneConfig longer = scene;
        longer.duration_s = 1000.5;
        longer.traffic.reset();
        longer.trajectories = file.string();
        build_world(longer);
      }),
      refused([&] {
        read_cloud(folder.write("turned.pcd",
                                "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
                                "WIDTH 1\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0.5 0 0\nPOINTS 1\n"
                                "DATA ascii\n1 2 3\n"));
      })};
}

TEST(locale, with_a_decimal_comma_changes_no_text) {
  const std::vector<std::string> before = texts();
  const CommaLocale comma;
  ASSERT_TRUE(comma.is_set()) << "localedef made no locale";
  ASSERT_EQ(printed(1.5), "1,5");
  const std::vector<std::string> now = texts();
  ASSERT_EQ(now.size(), before.size());
  for (std::size_t i = 0; i < now.size(); ++i) EXPECT_EQ(now[i], before[i]);
}

}  // namespace
}  // namespace infrasim
