#include "store/archive.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

#include "support/bag_bytes.hpp"
#include "support/disk_calls.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace archive_test {

namespace fs = std::filesystem;
using namespace ::stillmap::test;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

std::string bytes_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Files with their bytes, and folders with a slash, by path.
std::map<std::string, std::string> tree(const fs::path& folder) {
  std::map<std::string, std::string> found;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string path = entry.path().lexically_relative(folder);
    if (entry.is_directory())
      found[path + "/"] = "";
    else
      found[path] = bytes_of(entry.path());
  }
  return found;
}

class ArchiveTest : public ::testing::Test {
 protected:
  ExtractedArchive extract(const ByteSource& source, const ArchiveLimits& limits = {}) {
    return extract_archive({source, "upload", limits}, target_, calls_);
  }

  TemporaryFolder folder_{memory_folder()};
  UnsyncedCalls calls_;
  fs::path target_ = folder_.path() / "target";
};

TEST_F(ArchiveTest, UnpacksWhicheverPackingInPiecesOfAnySize) {
  std::string noise(3000, '\0');
  for (std::size_t i = 0; i < noise.size(); ++i) noise[i] = static_cast<char>(i * i >> 3U);
  const std::string tar = tar_folder("tiles/") + tar_file("tiles/0_0_0.bin", noise) +
                          tar_file("empty", "") + tar_file("a/b/c", "deep") + tar_end();
  for (const Packing packing : {Packing::kNone, Packing::kGzip, Packing::kZstd}) {
    const std::string bytes = packed(tar, packing);
    for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{511}, SIZE_MAX}) {
      const ExtractedArchive extracted = extract(source_of(bytes, piece));
      EXPECT_EQ(extracted.files, 3U);
      EXPECT_EQ(extracted.bytes, 3004U);
      EXPECT_EQ(extracted.packed_bytes, bytes.size());
      EXPECT_EQ(extracted.sha256, maps::sha256_of(bytes));
      EXPECT_THAT(tree(target_), ElementsAre(Pair("a/", ""), Pair("a/b/", ""),
                                             Pair("a/b/c", "deep"), Pair("empty", ""),
                                             Pair("tiles/", ""), Pair("tiles/0_0_0.bin", noise)));
      fs::remove_all(target_);
    }
  }
}

TEST_F(ArchiveTest, TakesNamesFromPaxAndGnuHeadersAndPrefixes) {
  const std::string longer = std::string(80, 'p') + "/" + std::string(90, 'l');
  const std::string gnu = tar_block({.name = "././@LongLink", .bytes = 172, .type = 'L'}) +
                          padded(longer + std::string(1, '\0'));
  extract(source_of(pax_header(pax_record("comment", "of all"), 'g') +
                    pax_header(pax_record("path", "pax") + pax_record("size", "3")) +
                    tar_file("cut", "one") + gnu + tar_file("cut", "two") +
                    tar_block({.name = "name", .bytes = 5, .prefix = "prefix"}) + padded("three") +
                    tar_file("./dotted", "") + tar_end()));
  EXPECT_THAT(tree(target_), ElementsAre(Pair("dotted", ""), Pair("pax", "one"),
                                         Pair(std::string(80, 'p') + "/", ""), Pair(longer, "two"),
                                         Pair("prefix/", ""), Pair("prefix/name", "three")));
}

TEST_F(ArchiveTest, TakesNothingButNamesAndBytes) {
  extract(source_of(tar_block({.name = "set", .bytes = 1, .mode = 07777}) + padded("x") +
                    pax_header(pax_record("uname", "J\xc3\xbcrgen") + pax_record("mtime", "1.5")) +
                    tar_file("owner", "y") + tar_end()));
  constexpr auto kSpecial = fs::perms::set_uid | fs::perms::set_gid | fs::perms::sticky_bit |
                            fs::perms::owner_exec | fs::perms::others_exec;
  EXPECT_EQ(fs::status(target_ / "set").permissions() & kSpecial, fs::perms::none);
  EXPECT_EQ(bytes_of(target_ / "owner"), "y");
}

/// Debian's tar and Python write tars of their own kinds.
TEST_F(ArchiveTest, TakesWhatTarAndPythonWrite) {
  folder_.write("in/tiles/0_0_0.bin", "points");
  folder_.write("in/long/" + std::string(98, 'n'), "long");
  const std::string in = (folder_.path() / "in").string();
  const std::string out = (folder_.path() / "out").string();
  const auto expected = tree(in);
  const std::string name = "long/" + std::string(98, 'n');
  const std::vector<std::string> commands = {
      "tar cf OUT -C IN .",
      "tar czf OUT -C IN tiles " + name,
      "tar cf OUT --format=pax -C IN .",
      "tar cf OUT --format=ustar -C IN tiles && tar rf OUT --format=gnu -C IN " + name,
      "python3 -c 'import tarfile; tar = tarfile.open(\"OUT\", \"w\"); tar.add(\"IN\", \".\"); "
      "tar.close()'",
  };
  for (const std::string& command : commands) {
    std::string line = command;
    for (std::size_t at; (at = line.find("OUT")) != line.npos;) line.replace(at, 3, out);
    for (std::size_t at; (at = line.find("IN")) != line.npos;) line.replace(at, 2, in);
    SCOPED_TRACE(line);
    ASSERT_EQ(std::system(line.c_str()), 0);
    EXPECT_NO_THROW(extract(source_of(bytes_of(out))));
    EXPECT_EQ(tree(target_), expected);
    fs::remove_all(target_);
  }
}

TEST_F(ArchiveTest, LeavesNothingBehindWhicheverCallFails) {
  const std::string tar = tar_file("a/b", std::string(2000, 'x')) + tar_file("c", "y") + tar_end();
  for (const Fault fault : {Fault::kNoSpace, Fault::kInputOutput, Fault::kShortWrite}) {
    bool failed = true;
    for (std::size_t at = 0; failed; ++at) {
      FailingCalls calls(fault, [&](std::size_t n, const auto&) { return n == at; });
      try {
        extract_archive({source_of(tar), "upload"}, target_, calls);
        EXPECT_EQ(tree(target_).size(), 3U);
        fs::remove_all(target_);
      } catch (const maps::StorageError&) {
        EXPECT_FALSE(fs::exists(target_)) << "call " << at;
      }
      failed = calls.failed() > 0;
    }
  }
}

TEST_F(ArchiveTest, EndsWithWhatTheSourceThrows) {
  const std::string tar =
      packed(tar_file("a", std::string(100'000, 'x')) + tar_end(), Packing::kGzip);
  for (std::size_t good = 0; good < tar.size(); good += 13) {
    std::size_t given = 0;
    const ByteSource source = [&](std::span<char> into) -> std::size_t {
      if (given >= good) throw std::out_of_range("client is gone");
      into[0] = tar[given++];
      return 1;
    };
    EXPECT_THAT([&] { extract(source); }, ThrowsSaying<std::out_of_range>({"client is gone"}));
    EXPECT_FALSE(fs::exists(target_));
  }
}

TEST_F(ArchiveTest, AsksTheSourceUpToItsEnd) {
  for (const Packing packing : {Packing::kNone, Packing::kGzip, Packing::kZstd}) {
    ByteSource inner = source_of(packed(tar_file("a", "x") + tar_end(), packing));
    const ByteSource checked = [&](std::span<char> into) {
      const std::size_t got = inner(into);
      if (got == 0) throw maps::InputError("body", "a wrong digest", "a right one");
      return got;
    };
    EXPECT_THAT([&] { extract(checked); }, ThrowsSaying<maps::InputError>({"a wrong digest"}));
    EXPECT_FALSE(fs::exists(target_));
  }
}

TEST_F(ArchiveTest, RefusesATargetThatIsThere) {
  folder_.write("target/old", "kept");
  EXPECT_THAT([&] { extract(source_of(tar_end())); },
              ThrowsSaying<maps::StorageError>({"there already"}));
  EXPECT_EQ(bytes_of(target_ / "old"), "kept");
}

TEST_F(ArchiveTest, JoinsPartsAsOneFile) {
  const std::string tar = tar_file("a", std::string(5000, 'x')) + tar_end();
  std::vector<fs::path> parts;
  for (std::size_t at = 0; at < tar.size(); at += 777)
    parts.push_back(folder_.write("parts/" + std::to_string(at), tar.substr(at, 777)));
  parts.push_back(folder_.write("parts/empty", ""));
  EXPECT_EQ(extract(concatenated(parts)).packed_bytes, tar.size());
  parts.push_back(folder_.path() / "parts" / "gone");
  fs::remove_all(target_);
  EXPECT_THAT([&] { extract(concatenated(parts)); }, ThrowsSaying<maps::StorageError>({"gone"}));
  EXPECT_FALSE(fs::exists(target_));
}

class DriveArchiveTest : public ArchiveTest {
 protected:
  static std::string scan() { return std::string(64, '\x3f'); }
  ExtractedDrive drive(const std::string& tar) {
    return extract_drive({source_of(tar), "upload"}, target_, calls_);
  }
};

TEST_F(DriveArchiveTest, FindsTheDriveInItsFolder) {
  const std::string scans =
      tar_file("a/velodyne/000000.bin", scan()) + tar_file("a/velodyne/000001.bin", scan());
  const ExtractedDrive inside = drive(scans + tar_file("a/times.txt", "0\n0.1\n") + tar_end());
  EXPECT_EQ(inside.root, target_ / "a");
  ASSERT_TRUE(inside.opened.drive);
  EXPECT_EQ(inside.opened.drive->contents().layout, maps::DriveLayout::kKittiOdometry);
  EXPECT_EQ(inside.opened.drive->size(), 2U);
  fs::remove_all(target_);
  EXPECT_EQ(drive(tar_file("0.bin", scan()) + tar_end()).root, target_);
}

TEST_F(DriveArchiveTest, FindsABagAndWhatIsChosenOfIt) {
  const std::string file = tar_file("run/run_0.mcap", test::bag_of_two_clouds());
  const ExtractedDrive found =
      drive(file + tar_file("run/topics.txt", "cloud=/cloud2\n") + tar_end());
  EXPECT_EQ(found.root, target_ / "run");
  ASSERT_TRUE(found.opened.drive);
  EXPECT_EQ(found.opened.drive->contents().layout, maps::DriveLayout::kMcap);
  EXPECT_EQ(found.opened.drive->size(), 1U);
  fs::remove_all(target_);
  const ExtractedDrive undecided = drive(file + tar_end());
  EXPECT_FALSE(undecided.opened.drive);
  ASSERT_TRUE(undecided.opened.needs_choice);
  EXPECT_THAT(undecided.opened.needs_choice->what(),
              HasSubstr("/cloud1 (1 clouds in 'lidar'), /cloud2 (1 clouds in 'lidar')"));
  EXPECT_EQ(open_drive_folder(undecided.root, "cloud=/cloud1").drive->size(), 1U);
}

TEST_F(DriveArchiveTest, RefusesWhatIsNoDrive) {
  EXPECT_THAT([&] { drive(tar_file("a/readme.txt", "x") + tar_end()); },
              ThrowsSaying<maps::InputError>({"no layout that is known"}));
  EXPECT_FALSE(fs::exists(target_));
  // What is broken is not taken for another layout further down.
  EXPECT_THAT(
      [&] {
        drive(tar_file("a/velodyne/000000.bin", scan()) +
              tar_file("a/velodyne/000001.bin", scan()) + tar_file("a/times.txt", "0\n") +
              tar_end());
      },
      ThrowsSaying<maps::InputError>({"times.txt"}));
  EXPECT_FALSE(fs::exists(target_));
}

}  // namespace archive_test
}  // namespace stillmap::server
