#include <stillmap/maps/scan_file.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <cmath>
#include <limits>

#include "scan_bytes.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace scan_file_test {

using test::append;
using test::append_big_endian;
using test::TemporaryFolder;
using test::xyzi;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

DecodedScan decode(const std::string& bytes, ScanFormat format, std::size_t max_points = 1000) {
  return decode_scan(test::as_bytes(bytes), format, "a scan", max_points);
}

void expect_error(const std::string& bytes, ScanFormat format, const std::string& found) {
  EXPECT_THAT([&] { (void)decode(bytes, format); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("a scan"), HasSubstr(found))))
      << bytes.substr(0, 400);
}

/// Every beginning of the bytes either decodes or is an InputError; nothing else, and never more
/// points than whole.
void expect_survives_truncation(const std::string& bytes, ScanFormat format) {
  const std::size_t whole = decode(bytes, format).points_in_file;
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    // A copy of its own size, so that a sanitizer sees any read behind it.
    const std::string cut = bytes.substr(0, size);
    try {
      EXPECT_LE(decode(cut, format).points_in_file, whole);
    } catch (const InputError&) {
    }
  }
}

/// Every byte turned into some others: no crash, and memory within reason (max_points caps it).
void expect_survives_changed_bytes(const std::string& bytes, ScanFormat format) {
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (const int change : {1, 0x10, 0x80, 0xFF}) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ change);
      try {
        (void)decode(changed, format);
      } catch (const InputError&) {
      }
    }
  }
}

// ---- .bin

TEST(BinScan, GivesPositionsAndIntensities) {
  const DecodedScan scan = decode(xyzi(1, 2, 3, 0.5F) + xyzi(-4, 5, 6, 1), ScanFormat::kBinXyzi);
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(-4, 5, 6)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(0.5F, 1.0F));
  EXPECT_THAT(scan.cloud.time_offsets_s, IsEmpty());
  EXPECT_EQ(scan.points_in_file, 2U);
}

TEST(BinScan, WithoutIntensityTakesThreeNumbersAPoint) {
  std::string bytes;
  for (const float value : {1.F, 2.F, 3.F, 4.F, 5.F, 6.F}) append(bytes, value);
  const DecodedScan scan = decode(bytes, ScanFormat::kBinXyz);
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(4, 5, 6)));
  EXPECT_THAT(scan.cloud.intensities, IsEmpty());
}

TEST(BinScan, WithTimesTakesFiveNumbersAPoint) {
  const auto of = [](float t) { return xyzi(1, 2, 3, 0.5F) + xyzi(t, 0, 0, 0).substr(0, 4); };
  const DecodedScan scan = decode(of(-0.05F) + of(1.0F), ScanFormat::kBinXyzit);
  EXPECT_THAT(scan.cloud.positions, Each(Eigen::Vector3f(1, 2, 3)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(0.5F, 0.5F));
  EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(-0.05F, 1.0F));
  for (const float t : {kNan, kInf, 1.1F, -1e9F}) {
    expect_error(of(0.0F) + of(t), ScanFormat::kBinXyzit, "found point 1 at ");
  }
  expect_error(of(0.0F).substr(0, 16), ScanFormat::kBinXyzit, "a multiple of 20");
  // Of no return nobody reads the time.
  EXPECT_TRUE(decode(xyzi(0, 0, 0, 0) + xyzi(kNan, 0, 0, 0).substr(0, 4), ScanFormat::kBinXyzit)
                  .cloud.empty());
}

TEST(BinScan, DropsAndCountsWhatIsNoPoint) {
  const DecodedScan scan =
      decode(xyzi(kNan, 0, 0, 1) + xyzi(1, 1, 1, 2) + xyzi(0, 0, 0, 3) + xyzi(0, kInf, 0, 4) +
                 xyzi(0, 0, -kInf, 5) + xyzi(0, 0, 1e-20F, 6),
             ScanFormat::kBinXyzi);
  EXPECT_EQ(scan.points_in_file, 6U);
  EXPECT_EQ(scan.dropped.non_finite, 3U);
  EXPECT_EQ(scan.dropped.zero_range, 1U);
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(2.0F, 6.0F));
}

TEST(BinScan, KeepsAPointWhoseIntensityIsNan) {
  EXPECT_THAT(decode(xyzi(1, 1, 1, kNan), ScanFormat::kBinXyzi).cloud.intensities,
              ElementsAre(0.0F));
}

TEST(BinScan, OfNoBytesIsAnEmptyScan) {
  const DecodedScan scan = decode("", ScanFormat::kBinXyzi);
  EXPECT_EQ(scan.points_in_file, 0U);
  EXPECT_TRUE(scan.cloud.empty());
}

TEST(BinScan, OfAnySizeButWholePointsIsRefusedWithIt) {
  const std::string bytes = xyzi(1, 2, 3, 4) + xyzi(1, 2, 3, 4);
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    if (size % 16 == 0) {
      EXPECT_EQ(decode(bytes.substr(0, size), ScanFormat::kBinXyzi).points_in_file, size / 16);
    } else {
      expect_error(bytes.substr(0, size), ScanFormat::kBinXyzi,
                   "found " + std::to_string(size) + " bytes, expected a multiple of 16");
    }
  }
  expect_error(bytes.substr(0, 16), ScanFormat::kBinXyz, "a multiple of 12");
}

TEST(BinScan, OfTooManyPointsIsRefused) {
  EXPECT_THAT([] { (void)decode(xyzi(1, 2, 3, 4) + xyzi(1, 2, 3, 4), ScanFormat::kBinXyzi, 1); },
              ThrowsMessage<InputError>(HasSubstr("found 2 points, expected at most 1")));
}

// ---- PCD

std::string pcd(const std::string& fields, const std::string& sizes, const std::string& types,
                const std::string& counts, int points, const std::string& encoding,
                const std::string& body) {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS " + fields + "\nSIZE " + sizes + "\nTYPE " + types +
         "\nCOUNT " + counts + "\nWIDTH " + std::to_string(points) +
         "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + std::to_string(points) + "\nDATA " +
         encoding + "\n" + body;
}

std::string xyz_ascii(int points, const std::string& body) {
  return pcd("x y z", "4 4 4", "F F F", "1 1 1", points, "ascii", body);
}

TEST(PcdScan, IsReadFromText) {
  const DecodedScan scan =
      decode(xyz_ascii(3, "1 2 3\r\n-4e1 +5 .5\nnan nan nan\n"), ScanFormat::kPcd);
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(-40, 5, 0.5F)));
  EXPECT_EQ(scan.dropped.non_finite, 1U);
  EXPECT_EQ(scan.points_in_file, 3U);
}

TEST(PcdScan, TakesItsLastLineWithoutANewline) {
  EXPECT_EQ(decode(xyz_ascii(2, "1 2 3\n4 5 6"), ScanFormat::kPcd).cloud.size(), 2U);
}

/// z before x, doubles, a ring, padding of 3 and U2 intensity.
std::string mixed_point(double z, std::uint8_t ring, float x, float y, std::uint16_t intensity) {
  std::string bytes;
  append(bytes, z);
  append(bytes, ring);
  bytes += "PAD";
  append(bytes, x);
  append(bytes, y);
  append(bytes, intensity);
  return bytes;
}

std::string mixed_pcd() {
  return pcd("z ring _ x y intensity", "8 1 1 4 4 2", "F U U F F U", "1 1 3 1 1 1", 2, "binary",
             mixed_point(3.5, 9, 1, 2, 65535) + mixed_point(-3.5, 8, -1, -2, 7));
}

void expect_mixed(const DecodedScan& scan) {
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3.5F), Eigen::Vector3f(-1, -2, -3.5F)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(65535.0F, 7.0F));
}

TEST(PcdScan, IsReadWithAnyFieldOrderTypeAndPadding) {
  expect_mixed(decode(mixed_pcd(), ScanFormat::kPcd));
}

std::string mixed_columns(bool with_padding) {
  std::string columns;
  for (const double z : {3.5, -3.5}) append(columns, z);
  columns += "\x09\x08";
  if (with_padding) columns += "PADPAD";
  for (const float x : {1.0F, -1.0F}) append(columns, x);
  for (const float y : {2.0F, -2.0F}) append(columns, y);
  for (const int i : {65535, 7}) append(columns, static_cast<std::uint16_t>(i));
  return columns;
}

TEST(PcdScan, IsUnpackedWithAndWithoutThePaddingThatPclLeavesOut) {
  for (const bool with_padding : {false, true}) {
    expect_mixed(
        decode(pcd("z ring _ x y intensity", "8 1 1 4 4 2", "F U U F F U", "1 1 3 1 1 1", 2,
                   "binary_compressed", test::pcd_compressed_body(mixed_columns(with_padding))),
               ScanFormat::kPcd));
  }
}

TEST(PcdScan, OfAnyIntegerTypeIsConverted) {
  std::string body;
  append(body, std::int8_t{-5});
  append(body, std::int16_t{-500});
  append(body, std::int64_t{1'000'000});
  append(body, std::uint32_t{4'000'000'000});
  const DecodedScan scan =
      decode(pcd("x y z i", "1 2 8 4", "I I I U", "1 1 1 1", 1, "binary", body), ScanFormat::kPcd);
  EXPECT_THAT(scan.cloud.positions, ElementsAre(Eigen::Vector3f(-5, -500, 1e6F)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(4e9F));
}

TEST(PcdScan, UnpacksRunsLongerThanTheWindowAndTheBuffer) {
  // 20,000 points: 240 kB in columns, more than one piece; x repeats (overlapping references), y
  // and z vary.
  constexpr int kPoints = 20'000;
  std::string columns;
  for (int i = 0; i < kPoints; ++i) append(columns, 1.0F);
  for (int i = 0; i < kPoints; ++i) append(columns, static_cast<float>(i % 500));
  for (int i = 0; i < kPoints; ++i) append(columns, static_cast<float>(i % 7));
  // Runs by hand: the test's own search would take seconds on the whole.
  std::string packed;
  const auto literals = [&packed](std::string_view bytes) {
    for (std::size_t i = 0; i < bytes.size(); i += 32) {
      const std::string_view run = bytes.substr(i, 32);
      packed += static_cast<char>(run.size() - 1);
      packed += run;
    }
  };
  literals(std::string_view(columns).substr(0, 4));
  std::size_t repeated = 4UL * kPoints - 4;
  for (; repeated >= 264 + 12; repeated -= 264) packed += std::string("\xE0\xFF\x03", 3);
  literals(std::string_view(columns).substr(4UL * kPoints - repeated));
  std::string body;
  append(body, static_cast<std::uint32_t>(packed.size()));
  append(body, static_cast<std::uint32_t>(columns.size()));
  const DecodedScan scan =
      decode(pcd("x y z", "4 4 4", "F F F", "1 1 1", kPoints, "binary_compressed", body + packed),
             ScanFormat::kPcd, kPoints);
  ASSERT_EQ(scan.cloud.size(), 20'000U);
  for (std::size_t i = 0; i < scan.cloud.size(); ++i) {
    const auto y = static_cast<float>(i % 500);
    const auto z = static_cast<float>(i % 7);
    ASSERT_EQ(scan.cloud.positions[i], Eigen::Vector3f(1, y, z)) << i;
  }
}

TEST(PcdScan, ReadsOldVersionsWithoutCountHeightAndPoints) {
  const std::string text =
      "VERSION .5\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nDATA ascii\n1 2 3\n";
  EXPECT_EQ(decode(text, ScanFormat::kPcd).cloud.size(), 1U);
}

TEST(PcdScan, ReadsTypesInSmallLetters) {
  const std::string text =
      pcd("x y z ring", "4 8 4 2", "f f f u", "1 1 1 1", 1, "ascii", "1 2 3 4\n");
  EXPECT_THAT(decode(text, ScanFormat::kPcd).cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3)));
}

TEST(PcdScan, KeepsPointsAsTheyAreUnderAViewpoint) {
  std::string text = xyz_ascii(1, "1 2 3\n");
  const std::string identity = "0 0 0 1 0 0 0";
  text.replace(text.find(identity), identity.size(), "9 9 9 0 1 0 0");
  EXPECT_THAT(decode(text, ScanFormat::kPcd).cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3)));
}

TEST(PcdScan, TakesAFieldOfNoNumbers) {
  EXPECT_EQ(decode(pcd("x y z rgb", "4 4 4 4", "F F F U", "1 1 1 0", 1, "ascii", "1 2 3\n"),
                   ScanFormat::kPcd)
                .cloud.size(),
            1U);
}

TEST(PcdScan, WhosePointsBeginLikeAHeaderLineIsReadAsPoints) {
  std::string body = "DATA";
  for (const float value : {2.0F, 3.0F}) append(body, value);
  EXPECT_EQ(decode(pcd("x y z", "4 4 4", "F F F", "1 1 1", 1, "binary", body), ScanFormat::kPcd)
                .cloud.size(),
            1U);
}

TEST(PcdScan, ReadsReflectivityWhenThereIsNoIntensity) {
  EXPECT_THAT(decode(pcd("x y z Reflectivity intensity", "4 4 4 4 4", "F F F F F", "1 1 1 1 1", 1,
                         "ascii", "1 2 3 4 5\n"),
                     ScanFormat::kPcd)
                  .cloud.intensities,
              ElementsAre(5.0F));
  EXPECT_THAT(
      decode(pcd("x y z Reflectivity", "4 4 4 4", "F F F F", "1 1 1 1", 1, "ascii", "1 2 3 4\n"),
             ScanFormat::kPcd)
          .cloud.intensities,
      ElementsAre(4.0F));
}

std::vector<float> times_of(const std::string& names, const std::string& type,
                            const std::string& size, const std::string& values) {
  const bool two = names.find(' ') != std::string::npos;
  return decode(pcd("x y z " + names, "4 4 4 " + size + (two ? " " + size : ""),
                    "F F F " + type + (two ? " " + type : ""), two ? "1 1 1 1 1" : "1 1 1 1", 1,
                    "ascii", "1 2 3 " + values + "\n"),
                ScanFormat::kPcd)
      .cloud.time_offsets_s;
}

TEST(PcdScan, ReadsTimesOnlyWhereTheirUnitAndZeroAreClear) {
  EXPECT_THAT(times_of("time", "F", "4", "0.05"), ElementsAre(0.05F));
  EXPECT_THAT(times_of("t", "U", "4", "50000000"), ElementsAre(0.05F));
  EXPECT_THAT(times_of("offset_time", "I", "8", "-50000000"), ElementsAre(-0.05F));
  EXPECT_THAT(times_of("timestamp", "F", "8", "1624254615.78"), IsEmpty());
  EXPECT_THAT(times_of("t", "F", "4", "50000"), IsEmpty());
  EXPECT_THAT(times_of("t", "F", "4", "nan"), IsEmpty());
  EXPECT_THAT(times_of("t time", "F", "4", "0.05 0.05"), IsEmpty());
}

TEST(PcdScan, NamesTheFieldsFoundWhenACoordinateIsMissing) {
  expect_error(pcd("x y range", "4 4 4", "F F F", "1 1 1", 1, "ascii", "1 2 3\n"), ScanFormat::kPcd,
               "found fields x y range, expected one field 'z'");
  expect_error(pcd("x y z z", "4 4 4 4", "F F F F", "1 1 1 1", 1, "ascii", "1 2 3 4\n"),
               ScanFormat::kPcd, "one field 'z'");
  expect_error(pcd("x y z", "4 4 4", "F F F", "1 1 0", 1, "ascii", "1 2\n"), ScanFormat::kPcd,
               "one field 'z'");
}

TEST(PcdScan, NamesWhatIsWrongInItsHeader) {
  const std::string good = xyz_ascii(1, "1 2 3\n");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  expect_error(with("VERSION 0.7", "VERSION 0.8"), ScanFormat::kPcd, "VERSION '0.8'");
  expect_error(with("SIZE 4 4 4", "SIZE 4 4"), ScanFormat::kPcd, "2 SIZE");
  expect_error(with("SIZE 4 4 4", "SIZE 4 4 3"), ScanFormat::kPcd, "SIZE '3'");
  expect_error(with("TYPE F F F", "TYPE F F Q"), ScanFormat::kPcd, "TYPE 'Q'");
  expect_error(with("COUNT 1 1 1", "COUNT 1 1 99999999999"), ScanFormat::kPcd, "COUNT");
  expect_error(with("WIDTH 1", "WIDTH -1"), ScanFormat::kPcd, "WIDTH");
  expect_error(with("POINTS 1", "POINTS 2"), ScanFormat::kPcd, "POINTS 2");
  expect_error(with("DATA ascii", "DATA zip"), ScanFormat::kPcd, "'zip'");
  expect_error(with("DATA ascii", "DATE ascii"), ScanFormat::kPcd, "'DATE ascii'");
  expect_error("", ScanFormat::kPcd, "without its DATA line");
  expect_error(std::string(1000, '\0'), ScanFormat::kPcd, "header line");
}

TEST(PcdScan, NamesTheLineOfABrokenPoint) {
  expect_error(xyz_ascii(2, "1 2 3\n4 5\n6 7"), ScanFormat::kPcd, "line 13: found 2 numbers");
  expect_error(xyz_ascii(1, "1 2 z\n"), ScanFormat::kPcd, "line 12: found 'z'");
  expect_error(xyz_ascii(1, "1 2 3 4\n"), ScanFormat::kPcd, "line 12: found more numbers");
  expect_error(xyz_ascii(2, "1000 2000 3000\n"), ScanFormat::kPcd, "found 1 lines of points");
}

TEST(PcdScan, ClaimingMoreThanItHoldsIsRefusedBeforeAllocating) {
  // 120 bytes that claim 2^31 points; with PCL this costs gigabytes.
  const std::string header =
      "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2147483648\nHEIGHT 1\nDATA ";
  for (const char* encoding : {"ascii\n", "binary\n", "binary_compressed\n"}) {
    EXPECT_THAT([&] { (void)decode(header + encoding, ScanFormat::kPcd, SIZE_MAX); },
                ThrowsMessage<InputError>(HasSubstr("bytes of points")))
        << encoding;
    expect_error(header + encoding, ScanFormat::kPcd, "2147483648 points");
  }
}

TEST(PcdScan, PackedSmallerThanLzfCanIsRefused) {
  std::string body;
  append(body, std::uint32_t{3});
  append(body, std::uint32_t{12'000'000});
  expect_error(pcd("x y z", "4 4 4", "F F F", "1 1 1", 1'000, "binary_compressed", body + "abc"),
               ScanFormat::kPcd, "12000000 unpacked bytes");
  std::string fitting;
  append(fitting, std::uint32_t{3});
  append(fitting, std::uint32_t{12'000});
  expect_error(pcd("x y z", "4 4 4", "F F F", "1 1 1", 1'000, "binary_compressed", fitting + "abc"),
               ScanFormat::kPcd, "3 packed bytes");
}

TEST(PcdScan, WithBrokenLzfIsRefused) {
  const auto packed = [](std::string_view stream) {
    std::string body;
    append(body, static_cast<std::uint32_t>(stream.size()));
    append(body, std::uint32_t{12});
    return pcd("x y z", "4 4 4", "F F F", "1 1 1", 1, "binary_compressed",
               body + std::string(stream));
  };
  using std::literals::operator""sv;
  expect_error(packed("\x20\x00"sv), ScanFormat::kPcd, "a reference before the first byte");
  expect_error(packed("\x0B"
                      "short"sv),
               ScanFormat::kPcd, "break off");
  expect_error(packed("\x00"
                      "a\xE0"sv),
               ScanFormat::kPcd, "break off");
  expect_error(packed("\x00"
                      "a\xE0\xFF\x00"sv),
               ScanFormat::kPcd, "go on");
  expect_error(packed("\x00"
                      "a"sv),
               ScanFormat::kPcd, "1 bytes");
}

TEST(PcdScan, SurvivesTruncationAndChangedBytes) {
  const std::string compressed =
      pcd("z ring _ x y intensity", "8 1 1 4 4 2", "F U U F F U", "1 1 3 1 1 1", 2,
          "binary_compressed", test::pcd_compressed_body(mixed_columns(true)));
  for (const std::string& bytes : {xyz_ascii(2, "1 2 3\n4 5 6\n"), mixed_pcd(), compressed}) {
    expect_survives_truncation(bytes, ScanFormat::kPcd);
    expect_survives_changed_bytes(bytes, ScanFormat::kPcd);
  }
}

// ---- PLY

TEST(PlyScan, IsReadFromTextWithElementsAndListsAround) {
  const std::string text =
      "ply\nformat ascii 1.0\ncomment made by hand\nelement camera 1\nproperty list uchar int ids\n"
      "property float focus\nelement vertex 2\nproperty float z\nproperty list uchar float extra\n"
      "property double x\nproperty float y\nproperty uchar intensity\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n3 7 8 9 0.5\n3 0 1 2 200\n"
      "-3 2 9 9 -1 -2 100\n3 0 1 0\n";
  const DecodedScan scan = decode(text, ScanFormat::kPly);
  EXPECT_THAT(scan.cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(-1, -2, -3)));
  EXPECT_THAT(scan.cloud.intensities, ElementsAre(200.0F, 100.0F));
}

std::string ply_header(const std::string& encoding, const std::string& vertices) {
  return "ply\nformat " + encoding + " 1.0\nelement other 1\nproperty list uchar short skipped\n" +
         "element vertex " + vertices +
         "\nproperty float x\nproperty double y\nproperty short z\nproperty float time\n" +
         "end_header\n";
}

std::string ply_little_endian() {
  std::string body;
  append(body, std::uint8_t{2});
  append(body, std::int16_t{5});
  append(body, std::int16_t{6});
  append(body, 1.0F);
  append(body, 2.0);
  append(body, std::int16_t{-3});
  append(body, 0.01F);
  return ply_header("binary_little_endian", "1") + body;
}

std::string ply_big_endian() {
  std::string body;
  append_big_endian(body, std::uint8_t{2});
  append_big_endian(body, std::int16_t{5});
  append_big_endian(body, std::int16_t{6});
  append_big_endian(body, 1.0F);
  append_big_endian(body, 2.0);
  append_big_endian(body, std::int16_t{-3});
  append_big_endian(body, 0.01F);
  return ply_header("binary_big_endian", "1") + body;
}

TEST(PlyScan, IsReadInBothByteOrders) {
  for (const std::string& bytes : {ply_little_endian(), ply_big_endian()}) {
    const DecodedScan scan = decode(bytes, ScanFormat::kPly);
    EXPECT_THAT(scan.cloud.positions, ElementsAre(Eigen::Vector3f(1, 2, -3)));
    EXPECT_THAT(scan.cloud.time_offsets_s, ElementsAre(0.01F));
  }
}

TEST(PlyScan, NamesWhatIsWrong) {
  const std::string start = "ply\nformat ascii 1.0\n";
  expect_error("plx\n", ScanFormat::kPly, "not 'ply'");
  expect_error("ply\nformat ascii 2.0\n", ScanFormat::kPly, "format 'ascii'");
  expect_error(start + "element vertex x\nend_header\n", ScanFormat::kPly, "element line");
  expect_error(start + "property float x\nend_header\n", ScanFormat::kPly, "'property float x'");
  expect_error(start + "element vertex 1\nproperty real x\n", ScanFormat::kPly, "'real'");
  expect_error(start + "element vertex 1\nproperty list float int x\n", ScanFormat::kPly,
               "list length");
  expect_error(start + "element vertex 1\nproperty float x\nend_header\n1\n", ScanFormat::kPly,
               "fields x");
  expect_error(start + "element face 0\nend_header\n", ScanFormat::kPly, "no element 'vertex'");
  expect_error(start + "element vertex 1\n", ScanFormat::kPly, "without its end_header");
  const std::string xyz = "property float x\nproperty float y\nproperty float z\nend_header\n";
  expect_error(start + "element vertex 2\n" + xyz + "1.5 2.5 3.5\n", ScanFormat::kPly, "break off");
  expect_error(start + "element vertex 1\n" + xyz + "1 2 b\n", ScanFormat::kPly, "'b'");
}

TEST(PlyScan, ClaimingMoreThanItHoldsIsRefusedBeforeAllocating) {
  for (const char* encoding : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    const std::string header = "ply\nformat " + std::string(encoding) + " 1.0\n";
    const std::string xyz = "property float x\nproperty float y\nproperty float z\nend_header\n";
    EXPECT_THAT(
        [&] {
          (void)decode(header + "element vertex 2147483648\n" + xyz, ScanFormat::kPly, SIZE_MAX);
        },
        ThrowsMessage<InputError>(HasSubstr("room for 2147483648")));
    expect_error(header + "element vertex 2147483648\n" + xyz, ScanFormat::kPly,
                 "2147483648 points");
    expect_error(
        header + "element a 18446744073709551615\nproperty int b\nelement vertex 1\n" + xyz,
        ScanFormat::kPly, "room for 18446744073709551615");
    // Elements without properties take no bytes and no time.
    expect_error(header + "element a 18446744073709551615\nelement vertex 1\n" + xyz,
                 ScanFormat::kPly, "room for 1 of");
  }
}

TEST(PlyScan, WithALongOrNegativeListIsRefused) {
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty list int int n\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n";
  expect_error(head + "4000000000 1 2 3\n", ScanFormat::kPly, "break off");
  expect_error(head + "-1 1 2 3\n", ScanFormat::kPly, "a list of -1");
  expect_error(head + "nan 1 2 3\n", ScanFormat::kPly, "a list of nan");
}

TEST(PlyScan, SurvivesTruncationAndChangedBytes) {
  const std::string text = ply_header("ascii", "1") + "2 5 6\n1 2 -3 0.01\n";
  for (const std::string& bytes : {text, ply_little_endian(), ply_big_endian()}) {
    expect_survives_truncation(bytes, ScanFormat::kPly);
    expect_survives_changed_bytes(bytes, ScanFormat::kPly);
  }
}

// ---- files

TEST(ScanFile, IsReadByItsExtension) {
  const TemporaryFolder folder;
  EXPECT_EQ(read_scan_file(folder.write("a.bin", xyzi(1, 2, 3, 4))).cloud.size(), 1U);
  EXPECT_EQ(read_scan_file(folder.write("a.pcd", xyz_ascii(1, "1 2 3\n"))).cloud.size(), 1U);
  EXPECT_EQ(read_scan_file(folder.write("a.ply", ply_big_endian())).cloud.size(), 1U);
}

TEST(ScanFile, OfUnknownExtensionOrMissingIsAClearError) {
  const TemporaryFolder folder;
  const auto las = folder.write("a.las", "x");
  EXPECT_THAT([&] { (void)read_scan_file(las); },
              ThrowsMessage<InputError>(AllOf(HasSubstr(las.string()), HasSubstr("'.las'"))));
  EXPECT_THAT([&] { (void)read_scan_file(folder.path() / "no.bin"); },
              ThrowsMessage<StorageError>(HasSubstr("no.bin")));
  std::filesystem::create_directory(folder.path() / "dir.bin");
  EXPECT_THROW((void)read_scan_file(folder.path() / "dir.bin"), StorageError);
}

TEST(ScanFile, OfAMapsSizeIsRefusedBeforeItIsRead) {
  const TemporaryFolder folder;
  const auto file = folder.write("map.pcd", "");
  std::filesystem::resize_file(file, (std::uintmax_t{1} << 30U) + 1);
  EXPECT_THAT([&] { (void)read_scan_file(file); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("map.pcd"), HasSubstr("1073741825 bytes"), HasSubstr("import"))));
}

}  // namespace scan_file_test
}  // namespace stillmap::maps
