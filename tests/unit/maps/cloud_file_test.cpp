#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/error.hpp>

#include <bit>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace cloud_file_test {

using test::TemporaryFolder;
using test::ThrowsSaying;

template <typename Number>
void put(std::string& bytes, double value) {
  const auto raw = std::bit_cast<std::array<char, sizeof(Number)>>(static_cast<Number>(value));
  bytes.append(raw.data(), raw.size());
}

struct Read {
  std::vector<CloudPoint> points;
  CloudSummary summary;
  std::size_t most_at_once = 0;
};

Read read(const TemporaryFolder& folder, const std::string& name, const std::string& bytes) {
  Read read;
  read.summary = read_cloud_file(folder.write(name, bytes), [&](std::span<const CloudPoint> some) {
    read.points.insert(read.points.end(), some.begin(), some.end());
    read.most_at_once = std::max(read.most_at_once, some.size());
  });
  return read;
}

std::string pcd_header(const std::string& size, std::size_t points, const std::string& data) {
  return fmt::format(
      "VERSION 0.7\nFIELDS x y z intensity\nSIZE {0} {0} {0} 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
      "WIDTH {1}\nHEIGHT 1\nPOINTS {1}\nDATA {2}\n",
      size, points, data);
}

constexpr double kEast = 448000.123456;

TEST(CloudFile, HeaderAloneTellsWhatCannotBeOne) {
  const auto check = [](const std::string& head, const char* format = "pcd") {
    check_cloud_header(std::as_bytes(std::span(head)), format, "upload");
  };
  const std::string good = pcd_header("4", 1'000'000, "binary");
  EXPECT_NO_THROW(check(good + "points that are still on their way"));
  EXPECT_THAT([&] { check(good.substr(0, good.find("DATA"))); },
              ThrowsSaying<InputError>({"upload", "DATA"}));
  EXPECT_THAT([&] { check("PK\x03\x04 no cloud"); }, ThrowsSaying<InputError>({"upload"}));
  EXPECT_THAT([&] { check(""); }, ThrowsSaying<InputError>({"upload"}));
  std::string flat = good;
  flat.replace(flat.find(" z "), 3, " w ");
  EXPECT_THAT([&] { check(flat); }, ThrowsSaying<InputError>({"one field 'z'"}));
  EXPECT_THAT([&] { check(good, "ply"); }, ThrowsSaying<InputError>({"upload", "'ply'"}));
  EXPECT_THAT([&] { check(good, "e57"); }, ThrowsSaying<std::invalid_argument>({"e57"}));

  const std::string ply =
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int ids\nelement vertex 9\n"
      "property float x\nproperty float y\nproperty float z\nend_header\n";
  EXPECT_NO_THROW(check(ply, "ply"));
  std::string faces = ply;
  faces.replace(faces.find("vertex"), 6, "corner");
  EXPECT_THAT([&] { check(faces, "ply"); }, ThrowsSaying<InputError>({"no element 'vertex'"}));
}

TEST(CloudFile, ViewpointOfAPcdIsTold) {
  const TemporaryFolder folder;
  const auto viewpoint = [&](const std::string& line) {
    return read(folder, "a.pcd",
                "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\n" + line +
                    "DATA ascii\n1 2 3\n")
        .summary.viewpoint;
  };
  const auto half_turn = viewpoint("VIEWPOINT 1 2 3 0 0 0 1\n");
  ASSERT_TRUE(half_turn);
  EXPECT_EQ(half_turn->translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(half_turn->linear() * Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(-1, 0, 0));
  const auto identity = viewpoint("VIEWPOINT 0 0 0 1 0 0 0\n");
  ASSERT_TRUE(identity);
  EXPECT_TRUE(identity->matrix().isIdentity(0.0));
  EXPECT_FALSE(viewpoint(""));
  EXPECT_FALSE(viewpoint("VIEWPOINT 0 0 0 1 0 0\n"));
  EXPECT_FALSE(viewpoint("VIEWPOINT 0 0 0 0 0 0 0\n"));
  EXPECT_FALSE(viewpoint("VIEWPOINT 0 0 nan 1 0 0 0\n"));
}

TEST(CloudFile, DoublesKeepAllTheirDigits) {
  const TemporaryFolder folder;
  std::string bytes = pcd_header("8", 2, "binary");
  for (const double x : {kEast, kEast + 1.0}) {
    put<double>(bytes, x);
    put<double>(bytes, 5427000.5);
    put<double>(bytes, 110.25);
    put<float>(bytes, 7.0);
  }
  const Read found = read(folder, "a.pcd", bytes);
  ASSERT_EQ(found.points.size(), 2U);
  EXPECT_EQ(found.points[0].position, Eigen::Vector3d(kEast, 5427000.5, 110.25));
  EXPECT_EQ(found.points[1].position.x(), kEast + 1.0);
  EXPECT_EQ(found.points[1].intensity, 7.0F);
  EXPECT_FALSE(found.summary.single_precision);
}

TEST(CloudFile, TextKeepsItsDigitsWhateverItsTypeSays) {
  const TemporaryFolder folder;
  const Read pcd =
      read(folder, "a.pcd", pcd_header("4", 1, "ascii") + "448000.123456 5427000.5 1 2\n");
  ASSERT_EQ(pcd.points.size(), 1U);
  EXPECT_EQ(pcd.points[0].position.x(), kEast);
  EXPECT_FALSE(pcd.summary.single_precision);
  const Read ply = read(folder, "a.ply",
                        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
                        "y\nproperty float z\nend_header\n448000.123456 5427000.5 1\n");
  ASSERT_EQ(ply.points.size(), 1U);
  EXPECT_EQ(ply.points[0].position.x(), kEast);
  EXPECT_EQ(ply.points[0].intensity, 0.0F);
}

TEST(CloudFile, FloatsAreToldApart) {
  const TemporaryFolder folder;
  std::string bytes =
      "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property double z\nend_header\n";
  std::string numbers;
  for (const double value : {1.5, -2.25}) {
    std::string one;
    put<float>(one, value);
    numbers.append(one.rbegin(), one.rend());
  }
  std::string z;
  put<double>(z, 3.125);
  numbers.append(z.rbegin(), z.rend());
  const Read found = read(folder, "a.ply", bytes + numbers);
  ASSERT_EQ(found.points.size(), 1U);
  EXPECT_EQ(found.points[0].position, Eigen::Vector3d(1.5, -2.25, 3.125));
  EXPECT_TRUE(found.summary.single_precision);
}

TEST(CloudFile, ComesInPiecesAndInOrder) {
  const TemporaryFolder folder;
  constexpr std::size_t kPoints = 150'000;
  std::string bytes = pcd_header("4", kPoints, "binary");
  for (std::size_t i = 0; i < kPoints; ++i) {
    put<float>(bytes, static_cast<double>(i));
    put<float>(bytes, i % 1000 == 7 ? std::numeric_limits<double>::quiet_NaN() : 1.0);
    put<float>(bytes, 2.0);
    put<float>(bytes, 3.0);
  }
  const Read found = read(folder, "a.pcd", bytes);
  EXPECT_EQ(found.summary.points_in_file, kPoints);
  EXPECT_EQ(found.summary.non_finite, 150U);
  ASSERT_EQ(found.points.size(), kPoints - 150);
  EXPECT_LT(found.most_at_once, kPoints / 2);
  for (std::size_t i = 1; i < found.points.size(); ++i)
    ASSERT_LT(found.points[i - 1].position.x(), found.points[i].position.x());
}

TEST(CloudFile, ColumnsOfACompressedFileArePutTogether) {
  const TemporaryFolder folder;
  std::string columns;
  for (const double value : {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0}) put<float>(columns, value);
  // LZF: a literal run of 32 bytes.
  std::string packed = std::string(1, '\x1f') + columns;
  std::string bytes = pcd_header("4", 2, "binary_compressed");
  for (const std::size_t size : {packed.size(), columns.size()}) {
    const auto raw = std::bit_cast<std::array<char, 4>>(static_cast<std::uint32_t>(size));
    bytes.append(raw.data(), raw.size());
  }
  const Read found = read(folder, "a.pcd", bytes + packed);
  ASSERT_EQ(found.points.size(), 2U);
  EXPECT_EQ(found.points[0].position, Eigen::Vector3d(1.0, 3.0, 5.0));
  EXPECT_EQ(found.points[1].position, Eigen::Vector3d(2.0, 4.0, 6.0));
  EXPECT_EQ(found.points[1].intensity, 8.0F);
}

TEST(CloudFile, ManyPointsOfACompressedFileComeInPieces) {
  constexpr std::size_t kPoints = 150'000;
  const TemporaryFolder folder;
  // The columns x, y, z and intensity of the header, one after the other.
  std::string columns;
  for (const double factor : {1.0, 2.0, -1.0, 0.5})
    for (std::size_t i = 0; i < kPoints; ++i) put<float>(columns, factor * static_cast<double>(i));
  std::string packed;
  for (std::size_t at = 0; at < columns.size(); at += 32) packed += '\x1f' + columns.substr(at, 32);
  std::string bytes = pcd_header("4", kPoints, "binary_compressed");
  put<std::uint32_t>(bytes, static_cast<double>(packed.size()));
  put<std::uint32_t>(bytes, static_cast<double>(columns.size()));
  const Read found = read(folder, "a.pcd", bytes + packed);
  ASSERT_EQ(found.points.size(), kPoints);
  EXPECT_LT(found.most_at_once, kPoints / 2);
  for (std::size_t i = 0; i < kPoints; ++i) {
    const double x = static_cast<double>(i);
    ASSERT_EQ(found.points[i].position, Eigen::Vector3d(x, 2.0 * x, -x)) << i;
    ASSERT_EQ(found.points[i].intensity, static_cast<float>(0.5 * x)) << i;
  }
  // Broken at its end: nothing of it is handed on.
  std::size_t handed_on = 0;
  packed[packed.size() - 33] = '\x1e';
  const auto broken = folder.write("b.pcd", bytes + packed);
  EXPECT_THAT([&] { (void)read_cloud_file(broken, [&](auto some) { handed_on += some.size(); }); },
              ThrowsSaying<InputError>({"b.pcd", "break off"}));
  EXPECT_EQ(handed_on, 0U);
}

TEST(CloudFile, WhatCannotBeReadIsRefusedInWords) {
  const TemporaryFolder folder;
  const auto refuses = [&](const std::string& name, const std::string& bytes,
                           const std::string& said) {
    EXPECT_THAT([&] { (void)read(folder, name, bytes); }, ThrowsSaying<InputError>({name, said}));
  };
  refuses("a.xyz", "1 2 3\n", ".pcd, .ply or .las");
  refuses("empty.pcd", "", "header");
  refuses("short.pcd", pcd_header("4", 2, "binary") + "12345678", "points");
  refuses("huge.pcd", pcd_header("4", 2'000'000'000, "binary") + "12345678", "2000000000");
  refuses("short.ply",
          "ply\nformat binary_little_endian 1.0\nelement vertex 9000000000000\nproperty float "
          "x\nproperty float y\nproperty float z\nend_header\n1234",
          "vertex");
  EXPECT_THROW((void)read_cloud_file(folder.path() / "none.pcd", {}), StorageError);
}

}  // namespace cloud_file_test
}  // namespace stillmap::maps
