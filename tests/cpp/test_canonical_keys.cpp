// The identity of folders and rows of results stays the same when a key is renamed.

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <tuple>
#include <vector>

#include "infrasim/config/fields.h"
#include "infrasim/core/files.h"
#include "infrasim/io/data_set.h"
#include "infrasim/pipeline/folder_identity.h"
#include "small_scenes.h"

namespace infrasim {

namespace {

struct Turning {
  double seam_deg = 180;
  std::optional<double> free_deg;
};

/// The same struct in a later version: one key is renamed, and one key is new.
struct LaterTurning {
  double cut_angle_deg = 180;
  bool dual_return = false;
  std::optional<double> free_deg;
};

template <class Own>
struct Unit {
  std::string name;
  Own spinning;
  std::map<std::string, Own> by_name;
  std::vector<Own> list;
};

template <class Fields>
void visit(Fields& f, Turning& c) {
  f.field("seam_deg", c.seam_deg, "");
  f.field("free_deg", c.free_deg, "");
}

template <class Fields>
void visit(Fields& f, LaterTurning& c) {
  f.field("cut_angle_deg", c.cut_angle_deg, "");
  f.field("dual_return", c.dual_return, "");
  f.field("free_deg", c.free_deg, "");
}

template <class Fields>
void visit(Fields& f, Unit<Turning>& c) {
  f.field("name", c.name, "");
  f.field("spinning", c.spinning, "");
  f.field("by_name", c.by_name, "");
  f.field("list", c.list, "");
}

template <class Fields>
void visit(Fields& f, Unit<LaterTurning>& c) {
  f.field("label", c.name, "");
  f.field("spinning", c.spinning, "");
  f.field("by_name", c.by_name, "");
  f.field("list", c.list, "");
}

using config::RenamedKey;
constexpr std::array kRenamed{RenamedKey{".label", "name"},
                              RenamedKey{"spinning.cut_angle_deg", "seam_deg"},
                              RenamedKey{"by_name.*.cut_angle_deg", "seam_deg"},
                              RenamedKey{"list.cut_angle_deg", "seam_deg"}};
constexpr std::array kLater{config::LaterKey{"dual_return", "false"}};
constexpr config::CanonicalKeys kTable{kRenamed, kLater};

// A name that the user has chosen is not a key, even if a key has the same name.
const std::string kOld = R"(name: "a"
spinning:
  seam_deg: 90
by_name:
  cut_angle_deg:
    seam_deg: 10
    free_deg: 1
  label:
    seam_deg: 20
list:
  - seam_deg: 30
  - seam_deg: 40
    free_deg: 2
)";

Unit<LaterTurning> read_later(const std::string& text) {
  return config::read_written<Unit<LaterTurning>>(config::parse_tree(text, "a.yaml"), kTable);
}

TEST(canonical_keys, a_renamed_key_keeps_the_text_that_a_folder_is_told_by) {
  const auto old = config::read_struct<Unit<Turning>>(config::parse_tree(kOld, "a.yaml"), {});
  ASSERT_EQ(config::canonical_text(old, {}), kOld);
  const Unit<LaterTurning> now = read_later(kOld);
  EXPECT_EQ(now.spinning.cut_angle_deg, 90);
  EXPECT_EQ(now.list.at(1).cut_angle_deg, 40);
  EXPECT_EQ(config::canonical_text(now, kTable), kOld);
  const std::string written = config::dump_struct(now);
  EXPECT_NE(written.find("cut_angle_deg: 90"), std::string::npos) << written;
  EXPECT_EQ(written.find("seam_deg"), std::string::npos) << written;
  EXPECT_EQ(config::canonical_text(read_later(written), kTable), kOld);
}

TEST(canonical_keys, a_later_key_counts_where_it_has_not_its_default) {
  Unit<LaterTurning> now = read_later(kOld);
  now.list[0].dual_return = true;
  const std::string text = config::canonical_text(now, kTable);
  EXPECT_NE(text.find("  - seam_deg: 30\n    dual_return: true\n  - seam_deg: 40\n"),
            std::string::npos)
      << text;
}

TEST(canonical_keys, a_key_under_both_names_is_refused) {
  const std::string message = testing::error_of<ConfigError>(
      [] { read_later("label: a\nspinning:\n  seam_deg: 1\n  cut_angle_deg: 1\n"); });
  EXPECT_TRUE(message.starts_with("a.yaml:3:")) << message;
  EXPECT_NE(message.find("seam_deg"), std::string::npos) << message;
}

TEST(canonical_keys, paths_end_as_patterns_do_at_whole_keys) {
  EXPECT_TRUE(config::ends_as(".a.b.c", "c"));
  EXPECT_TRUE(config::ends_as(".a.b.c", "b.c"));
  EXPECT_TRUE(config::ends_as(".a.b.c", "a.*.c"));
  EXPECT_TRUE(config::ends_as(".a.b.c", ".a.b.c"));
  EXPECT_FALSE(config::ends_as(".a.b.cc", "c"));
  EXPECT_FALSE(config::ends_as(".a.bb.c", "b.c"));
  EXPECT_FALSE(config::ends_as(".a.b.c", ".b.c"));
  EXPECT_FALSE(config::ends_as(".c", "b.c"));
}

// --- folders ------------------------------------------------------------------------------------

const std::filesystem::path kData =
    std::filesystem::path(INFRASIM_SOURCE_DIR) / "tests/data/v0_3/data";

std::string replaced(std::string text, const std::string& old, const std::string& now) {
  const auto at = text.find(old);
  EXPECT_NE(at, std::string::npos) << old;
  return text.replace(at, old.size(), now);
}

TEST(folder_identity, hangs_on_the_number_of_the_frames_and_not_on_the_version) {
  const std::string old = read_file(kData / "dataset.yaml");
  const auto of = [](const std::string& text) { return data_set_identity(text, "d.yaml"); };
  const std::string later = replaced(old, "\"0.3.0\"", "\"1.0.0\"\nframes_version: 3");
  EXPECT_EQ(of(old), of(later));
  EXPECT_NE(of(old), of(replaced(later, "frames_version: 3", "frames_version: 4")));
  EXPECT_NE(of(old), of(replaced(old, "0.3.0", "0.2.0")));
  EXPECT_NE(of(old), of(replaced(old, "seed: 1", "seed: 2")));
  EXPECT_NE(of(old), of(replaced(old, "\"datasheet\"", "\"paper\"")));
}

TEST(folder_identity, of_version_0_3_is_another_where_frames_have_changed_since) {
  const auto of = [](const std::string& text) { return data_set_identity(text, "d.yaml"); };
  const std::string site = read_file(kData / "dataset.yaml");
  const std::string end = "trajectories: \"\"";
  const std::string traffic =
      site.substr(site.find("traffic:"), site.find(end) + end.size() - site.find("traffic:"));
  const std::string junction = "\n  - roads: [road, road]";
  const std::string parked =
      "parked:\n  - {road: road, offset_m: 9, gap_m: 1, class_shares: {Car: 1}}\ntrajectories: "
      "\"\"";
  const auto replaced_in = [&](const std::string& text, const std::string& old,
                               const std::string& now) {
    return old.empty() ? text : replaced(text, old, now);
  };
  for (const auto& [old, now, changed] : std::vector<std::tuple<std::string, std::string, bool>>{
           {"", "", false},
           {"junctions: []", "junctions:" + junction, false},
           {"junctions: []", "junctions:" + junction + junction, true},
           {"rain_mm_per_h: 0", "rain_mm_per_h: 2.5", true},
           {"visibility_m: .inf", "visibility_m: 100", true},
           {"sunlight_klux: 100", "sunlight_klux: 5", false},
           {"trajectories: \"\"", parked, true},
           {traffic, "trajectories: \"cars.csv\"", true}}) {
    const std::string then = replaced_in(site, old, now);
    const std::string of_now = replaced(then, "\"0.3.0\"", "\"0.3.0\"\nframes_version: 3");
    EXPECT_EQ(of(then) != of(of_now), changed) << now;
    EXPECT_EQ(of(then).find("simulate again") != std::string::npos, changed) << now;
    const auto no_gap = [&](const std::string& text) {
      return of(replaced(text, "gap: true", "gap: false"));
    };
    if (now == parked) {
      EXPECT_EQ(no_gap(then), no_gap(of_now));
    }
  }
}

TEST(folder_identity, of_the_shipped_scenes_is_as_in_version_0_3) {
  for (const auto& entry : std::filesystem::directory_iterator(testing::configs() / "scenes"))
    for (const std::string preset : {"paper", "equal", "datasheet"}) {
      const std::string text =
          dump_scene(read_scene(entry.path(), {}, preset)) + "version: \"0.3.0\"\n";
      EXPECT_TRUE(data_set_identity(text, "d.yaml").ends_with("frames_version: 3\n"))
          << entry.path() << " " << preset;
    }
}

TEST(folder_identity, of_version_0_3_takes_no_lidar_whose_frames_have_changed_since) {
  const testing::TestFolder folder;
  const auto refused = [&](const LidarConfig& lidar, int end, const std::string& version) {
    const auto file = folder.write("dataset.yaml", "name: \"site\"\n" + version);
    try {
      check_is_not_older(file, {lidar}, end);
    } catch (const IoError& error) {
      EXPECT_NE(std::string(error.what()).find("in another folder"), std::string::npos)
          << error.what();
      return true;
    }
    return false;
  };
  const std::string then = "version: \"0.3.0\"\n", now = then + "frames_version: 3\n";
  for (const auto& entry : std::filesystem::directory_iterator(testing::configs() / "lidars")) {
    if (entry.path().extension() != ".yaml") continue;
    for (const std::string& preset : preset_names(entry.path()))
      EXPECT_FALSE(refused(read_lidar(entry.path(), preset), 5000, then)) << entry.path();
  }
  const LidarConfig shipped = read_lidar(testing::configs() / "lidars/helios_16.yaml", "datasheet");
  LidarConfig wide = shipped, step = shipped;
  wide.units.front().returns.beam = BeamConfig{.vertical_deg = 8, .horizontal_deg = 0.1};
  EXPECT_TRUE(refused(wide, 1, then));
  EXPECT_FALSE(refused(wide, 1, now));
  SpinningConfig& spinning = *step.units.front().pattern.spinning;
  spinning.columns_per_turn.reset();
  spinning.azimuth_step_deg = 0.2;
  EXPECT_FALSE(refused(step, 1000, then));
  EXPECT_TRUE(refused(step, 1001, then));
  EXPECT_FALSE(refused(step, 1001, now));
}

TEST(folder_identity, of_a_lidar_is_its_file_by_canonical_names) {
  const std::string old = read_file(kData / "turning/lidar.yaml");
  EXPECT_EQ(lidar_identity(old, "l.yaml"), old);
  const auto other = replaced(old, "seam_deg: 90", "seam_deg: 91");
  EXPECT_NE(lidar_identity(other, "l.yaml"), old);
}

TEST(claim, of_a_folder_that_says_the_same_in_other_words_is_fine) {
  const testing::TestFolder folder;
  const auto file = folder.path() / "dataset.yaml";
  const Identity first_letter = [](const std::string& text, const std::string&) {
    if (text.empty()) throw ConfigError("nothing");
    return text.substr(0, 1);
  };
  claim_file(file, "a of old", first_letter);
  EXPECT_NO_THROW(claim_file(file, "a of now", first_letter));
  EXPECT_EQ(read_file(file), "a of old");
  EXPECT_THROW(claim_file(file, "b", first_letter), IoError);
  EXPECT_THROW(claim_file(file, "", first_letter), IoError);
}

}  // namespace
}  // namespace infrasim
