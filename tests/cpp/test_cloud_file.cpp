#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <string>

#include "infrasim/core/errors.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/lzf.h"

namespace infrasim {
namespace {

namespace fs = std::filesystem;
using namespace std::string_literals;

constexpr PcdEncoding kEncodings[] = {PcdEncoding::kAscii, PcdEncoding::kBinary,
                                      PcdEncoding::kBinaryCompressed};

template <class... Values>
std::string packed(Values... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
  return bytes;
}

/// Returns a PCD header for `points` points of x y z, including the line DATA.
std::string xyz_header(int points, const std::string& data) {
  const std::string n = std::to_string(points);
  return "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " + n +
         "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA " + data + "\n";
}

const std::string kTwoPoints = packed(1.F, 2.F, 3.F, -4.F, 0.5F, 6.F);

std::string error_of(const std::string& bytes) {
  try {
    parse_pcd(bytes, "cloud.pcd");
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

std::string with(std::string text, const std::string& what, const std::string& instead) {
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), instead);
}

/// Returns a cloud with every type of field, an unknown name, a count above one, padding and random
/// values.
CloudFile cloud_of_every_type(std::size_t points) {
  CloudFile cloud;
  cloud.fields = {{"x"},
                  {"y", 'F', 8},
                  {"z"},
                  {"ring", 'U', 2},
                  {"a", 'I', 1},
                  {"b", 'I', 2},
                  {"c", 'I', 4},
                  {"d", 'I', 8},
                  {"e", 'U', 1, 3},
                  {"_", 'U', 1, 2},
                  {"f", 'U', 4},
                  {"g", 'U', 8},
                  {"h", 'F', 8, 2},
                  {"_", 'U', 1, 1}};
  cloud.points = points;
  std::mt19937 random(7);
  std::normal_distribution<float> normal(0, 50);
  std::normal_distribution<double> fine(0, 1e-6);
  for (std::size_t i = 0; i < points; ++i)
    for (const CloudField& f : cloud.fields)
      for (int k = 0; k < f.count; ++k)
        if (f.type == 'F')
          cloud.records += f.size == 4 ? packed(normal(random)) : packed(fine(random));
        else
          for (int b = 0; b < f.size; ++b) cloud.records += static_cast<char>(random());
  return cloud;
}

class cloud_file : public ::testing::Test {
 protected:
  void SetUp() override { fs::create_directories(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  fs::path folder_ =
      fs::temp_directory_path() /
      ("cloud_file_"s + ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST(bin, file_is_x_y_z_intensity) {
  const CloudFile cloud = parse_bin(packed(1.F, 2.F, 3.F, 0.25F), "a.bin");
  EXPECT_EQ(cloud.points, 1U);
  EXPECT_EQ(cloud.xyz(), (std::vector<float>{1, 2, 3}));
  EXPECT_EQ(cloud.column("intensity"), (std::vector<float>{0.25}));
  EXPECT_EQ(bin_bytes(cloud), packed(1.F, 2.F, 3.F, 0.25F));
  EXPECT_EQ(parse_bin("", "a.bin").points, 0U);
}

TEST(bin, truncated_file_is_an_error) {
  EXPECT_THROW(parse_bin(std::string(17, '\0'), "a.bin"), ConfigError);
}

TEST(bin, of_a_cloud_without_intensity_has_zeros) {
  const CloudFile cloud = parse_pcd(xyz_header(2, "binary") + kTwoPoints, "a.pcd");
  EXPECT_EQ(bin_bytes(cloud), packed(1.F, 2.F, 3.F, 0.F, -4.F, 0.5F, 6.F, 0.F));
}

TEST(bin, intensities_are_0_to_1) {
  const auto of = [](float a, float b) {
    return parse_bin(packed(0.F, 0.F, 0.F, a, 0.F, 0.F, 0.F, b), "a.bin");
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(of(0, 1).intensity_max(), 1);
  EXPECT_EQ(of(nan, 51).intensity_max(), 255);
  EXPECT_EQ(of(3, 256).intensity_max(), 65535);
  EXPECT_EQ(of(3, 1e6F).intensity_max(), 1);
  EXPECT_EQ(bin_bytes(of(0, 51), 255), bin_bytes(of(0, 0.2F)));
}

TEST(pcd, ascii_is_read) {
  const CloudFile cloud =
      parse_pcd("# made by hand\r\n" + xyz_header(2, "ascii") + "1 2 3\r\n-4 5e-1 6\n", "a.pcd");
  EXPECT_EQ(cloud.encoding, PcdEncoding::kAscii);
  EXPECT_EQ(cloud.records, kTwoPoints);
}

TEST(pcd, binary_is_read) {
  EXPECT_EQ(parse_pcd(xyz_header(2, "binary") + kTwoPoints, "a.pcd").records, kTwoPoints);
}

TEST(pcd, compressed_literals_are_read_field_after_field) {
  // Control byte 23: 24 literals.
  const std::string columns = packed(1.F, -4.F, 2.F, 0.5F, 3.F, 6.F);
  const std::string data = packed(25U, 24U) + "\x17" + columns;
  EXPECT_EQ(parse_pcd(xyz_header(2, "binary_compressed") + data, "a.pcd").records, kTwoPoints);
}

TEST(pcd, compressed_reference_may_overlap_what_it_writes) {
  // One literal zero, then 23 bytes from a distance of 1: 7 << 5, length - 9, distance - 1.
  const std::string data = packed(5U, 24U) + "\x00\x00\xe0\x0e\x00"s;
  EXPECT_EQ(parse_pcd(xyz_header(2, "binary_compressed") + data, "a.pcd").records,
            std::string(24, '\0'));
}

TEST(pcd, write_then_read_keeps_every_bit_of_every_field) {
  for (const PcdEncoding encoding : kEncodings)
    for (const std::size_t points : {0, 1, 1000}) {
      CloudFile cloud = cloud_of_every_type(points);
      cloud.encoding = encoding;
      cloud.viewpoint = "1 2 3 0 1 0 0";
      const CloudFile read = parse_pcd(pcd_bytes(cloud), "a.pcd");
      EXPECT_EQ(read.records, cloud.records);
      EXPECT_EQ(read.viewpoint, cloud.viewpoint);
      EXPECT_EQ(read.encoding, encoding);
      ASSERT_EQ(read.fields.size(), cloud.fields.size());
      for (std::size_t i = 0; i < read.fields.size(); ++i) {
        EXPECT_EQ(read.fields[i].name, cloud.fields[i].name);
        EXPECT_EQ(read.fields[i].type, cloud.fields[i].type);
        EXPECT_EQ(read.fields[i].size, cloud.fields[i].size);
        EXPECT_EQ(read.fields[i].count, cloud.fields[i].count);
      }
    }
}

TEST(pcd, ascii_keeps_infinities_and_the_smallest_and_largest_numbers) {
  using Limits = std::numeric_limits<float>;
  CloudFile cloud = parse_pcd(xyz_header(2, "ascii") + "0 0 0\n0 0 0\n", "a.pcd");
  cloud.records = packed(Limits::infinity(), -Limits::infinity(), -0.F, Limits::denorm_min(),
                         Limits::max(), Limits::min());
  EXPECT_EQ(parse_pcd(pcd_bytes(cloud), "a.pcd").records, cloud.records);
  cloud.records = packed(Limits::quiet_NaN(), 0.F, 0.F, 0.F, 0.F, 0.F);
  EXPECT_TRUE(std::isnan(parse_pcd(pcd_bytes(cloud), "a.pcd").xyz()[0]));
}

TEST(pcd, count_and_viewpoint_may_be_left_out) {
  std::string text = xyz_header(2, "ascii") + "1 2 3\n-4 0.5 6\n";
  text = with(with(text, "COUNT 1 1 1\n", ""), "VIEWPOINT 0 0 0 1 0 0 0\n", "");
  EXPECT_EQ(parse_pcd(text, "a.pcd").records, kTwoPoints);
}

TEST(pcd, column_converts_each_type_to_float) {
  CloudFile cloud;
  cloud.fields = {{"x", 'I', 2}, {"y", 'F', 8}, {"z", 'U', 1, 2}};
  cloud.points = 1;
  cloud.records = packed(std::int16_t{-300}, 2.5) + "\xff\x01";
  EXPECT_EQ(cloud.xyz(), (std::vector<float>{-300, 2.5, 255}));
  EXPECT_TRUE(cloud.column("ring").empty());
}

TEST(pcd, fields_are_found_whatever_their_capitals) {
  const std::string upper = with(xyz_header(2, "binary"), "FIELDS x y z", "FIELDS X Y Z");
  EXPECT_EQ(parse_pcd(upper + kTwoPoints, "a.pcd").xyz(), (std::vector<float>{1, 2, 3, -4, .5, 6}));
  CloudFile cloud;
  cloud.fields = {{"X"}, {"y"}, {"Z"}, {"Intensity", 'U', 2}};
  cloud.points = 1;
  cloud.records = packed(1.F, 2.F, 3.F, std::uint16_t{40000});
  EXPECT_EQ(bin_bytes(cloud), packed(1.F, 2.F, 3.F, 40000.F));
  EXPECT_EQ(parse_pcd(pcd_bytes(cloud), "a.pcd").fields[3].name, "Intensity");
  for (const char* name : {"Reflectivity", "I", "scalar_Intensity"}) {
    cloud.fields[3].name = name;
    EXPECT_EQ(cloud.intensity(), (std::vector<float>{40000})) << name;
  }
  cloud.fields = {{"x"}, {"X"}, {"y"}, {"z"}};
  cloud.records = packed(1.F, 2.F, 3.F, 4.F);
  EXPECT_EQ(cloud.xyz(), (std::vector<float>{1, 3, 4})) << "the exact name comes first";
  cloud.fields = {{"x"}, {"y"}, {"Z"}, {"z"}, {"INTENSITY"}, {"Intensity"}};
  EXPECT_EQ(cloud.field("intensity"), nullptr) << "which one is not known";
}

TEST(pcd, points_of_a_bin_are_where_the_viewpoint_moves_them) {
  const auto moved = [](const std::string& viewpoint) {
    CloudFile cloud = parse_pcd(xyz_header(2, "ascii") + "1 2 3\n0 0 0\n", "a.pcd");
    cloud.viewpoint = viewpoint;
    return cloud.moved_xyz();
  };
  const auto expect_at = [](const std::vector<float>& xyz, float x, float y, float z) {
    EXPECT_NEAR(xyz[0], x, 1e-6);
    EXPECT_NEAR(xyz[1], y, 1e-6);
    EXPECT_NEAR(xyz[2], z, 1e-6);
    for (int i : {3, 4, 5}) EXPECT_EQ(xyz[i], 0) << "no return";
  };
  expect_at(moved("0 0 0 1 0 0 0"), 1, 2, 3);
  expect_at(moved("10 20 30 1 0 0 0"), 11, 22, 33);
  expect_at(moved("0 0 5 0.70710678 0 0 0.70710678"), -2, 1, 8);
  expect_at(moved("0 0 0 0.72 0 0.72 0"), 3, 2, -1);
  expect_at(moved("0 0 5 0 0 0 0"), 1, 2, 8);
  expect_at(moved("691000 5336000 520 0 1 0 0"), 1, -2, -3);
}

TEST(pcd, select_takes_whole_records_in_order) {
  const CloudFile cloud = cloud_of_every_type(9);
  const std::size_t stride = cloud.record_size();
  const std::array<int, 2> keep = {7, 2};
  const CloudFile out = cloud.select(keep);
  EXPECT_EQ(out.points, 2U);
  EXPECT_EQ(out.records,
            cloud.records.substr(7 * stride, stride) + cloud.records.substr(2 * stride, stride));
}

TEST(pcd, error_names_file_line_and_key) {
  EXPECT_EQ(error_of(with(xyz_header(1, "ascii"), "HEIGHT 1", "HEIGHT one")),
            "cloud.pcd:7:1: HEIGHT: expected a whole number up to 1099511627776, "
            "got 'one'");
}

TEST(pcd, wrong_headers_are_errors) {
  const std::string good = xyz_header(2, "ascii") + "1 2 3\n-4 0.5 6\n";
  ASSERT_EQ(error_of(good), "no error");
  const std::array<const char*, 2> changes[] = {
      {"VERSION .7", "VERSION .6"},
      {"VERSION .7", "COLOUR red"},
      {"FIELDS x y z", "FIELDS x y q"},
      {"FIELDS x y z", "FIELDS x x z"},
      {"FIELDS x y z", "FIELDS"},
      {"FIELDS x y z", "FIELDS x y z w"},
      {"FIELDS x y z\n", ""},
      {"SIZE 4 4 4\n", ""},
      {"TYPE F F F\n", ""},
      {"SIZE 4 4 4", "SIZE 4 4"},
      {"SIZE 4 4 4", "SIZE 4 4 3"},
      {"SIZE 4 4 4", "SIZE 4 4 -4"},
      {"SIZE 4 4 4", "SIZE 2 4 4"},
      {"TYPE F F F", "TYPE F F D"},
      {"COUNT 1 1 1", "COUNT 1 1 0"},
      {"COUNT 1 1 1", "COUNT 1 1 99999999999999999999"},
      {"COUNT 1 1 1", "COUNT 1 1 2"},
      {"WIDTH 2", "WIDTH 3"},
      {"WIDTH 2", "WIDTH 2 2"},
      {"WIDTH 2", "WIDTH 2\nWIDTH 2"},
      {"HEIGHT 1", "HEIGHT 2"},
      {"HEIGHT 1", "HEIGHT 0"},
      {"POINTS 2", "POINTS 1"},
      {"POINTS 2\n", ""},
      {"WIDTH 2\nHEIGHT 1", "WIDTH 4294967296\nHEIGHT 4294967296"},
      {"VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0 0"},
      {"VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0 0 one 0 0 0"},
      {"VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0 0 nan 0 0 0"},
      {"VIEWPOINT 0 0 0 1 0 0 0", "VIEWPOINT 0 0 0 30 0 0 0"},
      {"DATA ascii", "DATA text"},
      {"1 2 3", "1 2"},
      {"1 2 3", "1 2 3 4"},
      {"1 2 3", "1 2 three"},
      {"1 2 3", "1 2 3x"},
      {"1 2 3", "1 2 1e99"},
      {"-4 0.5 6\n", ""},
      {"-4 0.5 6\n", "-4 0.5 6\n7 8 9\n"},
  };
  for (const auto& [what, instead] : changes)
    EXPECT_EQ(error_of(with(good, what, instead)).rfind("cloud.pcd:", 0), 0U) << instead;
}

TEST(pcd, integers_out_of_their_range_are_errors) {
  const std::string text =
      with(xyz_header(1, "ascii"), "SIZE 4 4 4\nTYPE F F F", "SIZE 1 1 2\nTYPE I U U");
  EXPECT_EQ(error_of(text + "-128 255 65535\n"), "no error");
  for (const char* row : {"-129 0 0", "0 256 0", "0 -1 0", "0 0 65536", "0.5 0 0"})
    EXPECT_NE(error_of(text + row + "\n"), "no error") << row;
}

TEST(pcd, promises_beyond_the_file_are_errors_before_memory_is_taken) {
  const auto huge = [](const std::string& data) {
    const std::string n = "1099511627776";
    return with(with(xyz_header(1, data), "WIDTH 1", "WIDTH " + n), "POINTS 1", "POINTS " + n);
  };
  EXPECT_NE(error_of(huge("ascii") + "1 2 3\n"), "no error");
  EXPECT_NE(error_of(huge("binary") + kTwoPoints), "no error");
  EXPECT_NE(error_of(huge("binary_compressed") + packed(5U, 24U) + "\0\0\xe0\x0e\0"s), "no error");
  EXPECT_NE(error_of(xyz_header(1 << 28, "binary_compressed") + packed(5U, 3221225472U) +
                     "\0\0\xe0\x0e\0"s),
            "no error");
}

TEST(pcd, every_cut_of_a_file_is_an_error) {
  for (const PcdEncoding encoding : kEncodings) {
    CloudFile cloud = cloud_of_every_type(3);
    cloud.encoding = encoding;
    const std::string bytes = pcd_bytes(cloud);
    // A text that ends within its last number still ends with a number, so it is no error.
    const std::size_t end = encoding == PcdEncoding::kAscii ? bytes.rfind(' ') : bytes.size();
    for (std::size_t n = 0; n < end; ++n)
      EXPECT_THROW(parse_pcd(bytes.substr(0, n), "a.pcd"), ConfigError) << n;
    EXPECT_THROW(parse_pcd(bytes + "7 7\n", "a.pcd"), ConfigError) << "more than promised";
  }
}

TEST(lzf, decompress_inverts_compress) {
  std::mt19937 random(3);
  for (const int values : {1, 2, 4, 256})
    for (const std::size_t size : {0, 1, 2, 3, 31, 32, 33, 264, 265, 8191, 8193, 100000}) {
      std::string bytes(size, '\0');
      for (char& c : bytes) c = static_cast<char>(static_cast<int>(random() >> 8) % values);
      const std::string small = lzf_compress(bytes);
      EXPECT_EQ(lzf_decompress(small, size), bytes) << size << " bytes of " << values << " values";
      EXPECT_LE(small.size(), size + size / 32 + 1);
    }
  EXPECT_LT(lzf_compress(std::string(100000, 'a')).size(), 1300U);
}

TEST(lzf, broken_data_gives_nothing) {
  EXPECT_EQ(lzf_decompress("\x05"s, 6), std::nullopt) << "literals missing";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\x20\x01"s, 4), std::nullopt) << "before the start";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\x20"s, 4), std::nullopt) << "distance missing";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\xe0"s, 99), std::nullopt) << "length missing";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\x20\x00"s, 3), std::nullopt) << "longer than stated";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\x20\x00"s, 5), std::nullopt) << "shorter than stated";
  EXPECT_EQ(lzf_decompress("\x00"s + "a" + "\x20\x00"s, 4), "aaaa");
}

TEST_F(cloud_file, suffix_decides_the_format) {
  const CloudFile cloud = parse_pcd(xyz_header(2, "ascii") + "1 2 3\n-4 0.5 6\n", "a.pcd");
  write_cloud(folder_ / "a.pcd", cloud);
  write_cloud(folder_ / "a.bin", cloud);
  EXPECT_EQ(read_cloud(folder_ / "a.pcd").records, kTwoPoints);
  EXPECT_EQ(read_cloud(folder_ / "a.bin").xyz(), cloud.xyz());
  EXPECT_EQ(fs::file_size(folder_ / "a.bin"), 32U);
  EXPECT_THROW(write_cloud(folder_ / "a.ply", cloud), ConfigError);
  EXPECT_THROW(read_cloud(write("b.ply", std::string(16, '\0'))), ConfigError);
}

TEST_F(cloud_file, what_cannot_be_read_or_written_is_an_io_error) {
  EXPECT_THROW(read_cloud(folder_ / "none.pcd"), IoError);
  EXPECT_THROW(read_cloud(folder_), std::runtime_error);
  EXPECT_THROW(write_cloud(folder_ / "none" / "a.bin", parse_bin("", "")), IoError);
}

TEST_F(cloud_file, failed_write_leaves_nothing_behind) {
  fs::create_directories(folder_ / "taken.bin" / "inside");
  try {
    write_file_atomically(folder_ / "taken.bin", "text");
    FAIL() << "wrote over a folder";
  } catch (const IoError& error) {
    EXPECT_NE(std::string(error.what()).find("taken.bin"), std::string::npos);
  }
  EXPECT_FALSE(fs::exists(folder_ / ".taken.bin.tmp"));
}

TEST_F(cloud_file, write_replaces_the_whole_file) {
  const fs::path file = write("a.txt", "something longer");
  write_file_atomically(file, "short");
  std::ifstream in(file);
  std::string text;
  std::getline(in, text);
  EXPECT_EQ(text, "short");
  EXPECT_FALSE(fs::exists(folder_ / ".a.txt.tmp"));
}

}  // namespace
}  // namespace infrasim
