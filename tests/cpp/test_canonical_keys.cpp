// The identity of folders and rows of results stays the same when a key is renamed.

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "infrasim/config/fields.h"
#include "infrasim/core/files.h"
#include "infrasim/core/version.h"
#include "infrasim/io/data_set.h"
#include "infrasim/pipeline/folder_identity.h"
#include "infrasim/pipeline/run_folder.h"
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

// A name that the user has chosen is not renamed, even if it equals the name of a key.
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

TEST(folder_identity, a_folder_of_another_number_is_refused_and_both_numbers_are_named) {
  const testing::TestFolder folder;
  const std::string now = std::to_string(kFramesVersion);
  const auto error = [&](const std::string& lines) {
    const auto file = folder.write("dataset.yaml", "name: \"site\"\n" + lines);
    return testing::error_of<IoError>([&] { check_frames_version(file); });
  };
  EXPECT_NO_THROW(check_frames_version(folder.path() / "none.yaml"));
  for (const auto& [lines, got] : std::vector<std::pair<std::string, std::string>>{
           {"version: \"0.3.0\"\n", "3"},
           {"version: \"0.2.0\"\n", "unknown, of version 0.2.0"},
           {"frames_version: 3\n", "3"},
           {"frames_version: 99\n", "99"}}) {
    const std::string message = error(lines);
    EXPECT_TRUE(message.ends_with("dataset.yaml:2: frames_version: expected " + now + ", got " +
                                  got + ": simulate again in another folder"))
        << message;
  }
  for (const std::string& lines :
       std::vector<std::string>{"frames_version: " + now + "\n", ": :\n- a\n"})
    EXPECT_NO_THROW(check_frames_version(folder.write("dataset.yaml", "name: \"site\"\n" + lines)));
}

TEST(folder_identity, of_a_lidar_is_its_file_by_canonical_names) {
  const std::string old = read_file(kData / "turning/lidar.yaml");
  EXPECT_EQ(lidar_identity(old, "l.yaml"), old);
  const auto other = replaced(old, "seam_deg: 90", "seam_deg: 91");
  EXPECT_NE(lidar_identity(other, "l.yaml"), old);
}

/// Returns a request for fused frames. The names of the mounts are such that YAML readers may take
/// them for numbers or other values.
RunRequest fused_request(const std::filesystem::path& out) {
  RunRequest request;
  request.scene = testing::empty_road();
  for (const char* name : {"1", "no", "010", "null"}) request.scene.mounts[name].x_m = 20;
  request.lidars = {testing::plain_lidar("lidar", testing::spinning(4, -20, 0, 1))};
  request.frames = {0, 1};
  request.out = out;
  return request;
}

void open_fused(const RunRequest& request) {
  const std::vector<World> worlds = build_worlds(request.scene, mount_names(request.scene));
  open_fused_folder(request, worlds.front(), Fusion(request.scene, worlds, 0.1));
}

TEST(fused_folder, of_a_lidar_with_another_value_is_refused) {
  const testing::TestFolder folder;
  const RunRequest request = fused_request(folder.path());
  open_fused(request);
  EXPECT_NO_THROW(open_fused(request));
  const auto expect_refused = [&](const auto& change) {
    RunRequest other = request;
    change(other.lidars.front().units.front());
    testing::expect_within(testing::error_of<IoError>([&] { open_fused(other); }), "lidar_digest");
  };
  expect_refused([](LidarUnit& unit) { unit.returns.range_accuracy_m = 0.02; });
  expect_refused([](LidarUnit& unit) { unit.returns.detection.emplace(); });
  expect_refused([](LidarUnit& unit) { unit.returns.drop_off.emplace(); });
}

TEST(fused_folder, of_an_earlier_version_goes_on) {
  const testing::TestFolder folder;
  const RunRequest request = fused_request(folder.path());
  open_fused(request);
  const auto file = folder.path() / "lidar" / "lidar.yaml";
  std::string text =
      replaced(read_file(file), R"([pole, "1", "no", "010", "null"])", "[pole, 1, no, 010, null]");
  text.resize(text.find("lidar_digest: "));
  folder.write("lidar/lidar.yaml", text);
  EXPECT_NO_THROW(open_fused(request));
  EXPECT_EQ(read_file(file), text);
}

TEST(claim, of_a_file_that_an_editor_saved_in_its_own_way_is_fine) {
  const testing::TestFolder folder;
  const auto file = folder.write("roads.csv", "\xEF\xBB\xBFroad,lane\r\na,1\r\n");
  EXPECT_NO_THROW(claim_file(file, "road,lane\na,1\n"));
  EXPECT_THROW(claim_file(file, "road,lane\na,2\n"), IoError);
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
