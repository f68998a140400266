// Archives that are made to do harm.
#include "store/archive.hpp"

#include <stillmap/maps/error.hpp>

#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace archive_attack_test {

namespace fs = std::filesystem;
using namespace ::stillmap::test;

class ArchiveAttackTest : public ::testing::Test {
 protected:
  void expect_refused(const std::string& bytes, const std::vector<std::string>& saying,
                      const ArchiveLimits& limits = {}) {
    SCOPED_TRACE(::testing::PrintToString(saying));
    EXPECT_THAT(
        [&] {
          extract_archive({source_of(bytes), "upload", limits}, target_, calls_);
        },
        ThrowsSaying<maps::InputError>(saying))
        << bytes.substr(0, 100);
    expect_nothing_left();
    fs::remove_all(target_);
  }
  void expect_nothing_left() {
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 0);
  }

  TemporaryFolder folder_{memory_folder()};
  UnsyncedCalls calls_;
  fs::path target_ = folder_.path() / "target";
};

const std::vector<std::string> kBadNames = {
    "/etc/passwd", "//x",  "../x",   "a/../../x", "a/..", "..",     "a/./b",
    "a//b",        "a\\b", "..\\x",  "C:\\x",     "a\nb", "a\x7f",  "a\x01",
    "\xc3\xbc",    ".//x", "./../x", "./",        ".",    "a/../b", "x/",
};

TEST_F(ArchiveAttackTest, NoNameLeadsOutsideHoweverItIsWritten) {
  for (const std::string& name : kBadNames) {
    // A file whose name ends with a slash is a folder to libarchive, and has no bytes then.
    expect_refused(tar_file(name, "x") + tar_end(), {"upload: entry '"});
    expect_refused(pax_header(pax_record("path", name)) + tar_file("good", "x") + tar_end(),
                   {"upload: entry '"});
    const std::string body = name + std::string(1, '\0');
    expect_refused(tar_block({.name = "././@LongLink", .bytes = body.size(), .type = 'L'}) +
                       padded(body) + tar_file("good", "x") + tar_end(),
                   {"upload: entry '"});
    expect_refused(
        pax_header(pax_record("GNU.sparse.name", name)) + tar_file("good", "x") + tar_end(),
        {"upload"});
  }
  for (const std::string name : {"/a/", "../a/", "a/../", "a//"})
    expect_refused(tar_folder(name) + tar_end(), {"upload: entry '"});
  expect_refused(tar_block({.name = "passwd", .prefix = "/etc"}) + tar_end(), {"absolute"});
  expect_refused(tar_block({.name = "x", .prefix = "../.."}) + tar_end(), {"'..'"});
}

TEST_F(ArchiveAttackTest, RefusesAllButFilesAndFolders) {
  struct Refused {
    char type;
    std::string saying;
  };
  for (const Refused& refused : std::vector<Refused>{{'1', "a hard link"},
                                                     {'2', "a link"},
                                                     {'3', "a device"},
                                                     {'4', "a device"},
                                                     {'6', "a pipe"},
                                                     {'7', "unknown type"},
                                                     {'D', "unknown type"},
                                                     {'M', "unknown type"},
                                                     {'N', "unknown type"},
                                                     {'Q', "unknown type"}}) {
    expect_refused(
        tar_block({.name = "evil", .type = refused.type, .link = "/etc/passwd"}) + tar_end(),
        {"entry 'evil'", refused.saying});
    expect_refused(
        tar_file("before", "x") +
            tar_block({.name = "evil", .bytes = 5, .type = refused.type, .link = "before"}) +
            padded("bytes") + tar_end(),
        {"upload"});
  }
  expect_refused(
      pax_header(pax_record("linkpath", "/etc/passwd")) + tar_file("evil", "x") + tar_end(),
      {"entry 'evil'", "a link"});
  expect_refused(tar_block({.name = "l", .bytes = 4, .type = 'K'}) + padded("/etc") +
                     tar_file("evil", "x") + tar_end(),
                 {"a link"});
  expect_refused(tar_block({.name = "label", .type = 'V'}) + tar_file("a", "x") + tar_end(),
                 {"unknown type"});
}

TEST_F(ArchiveAttackTest, RefusesSparseFilesOfEveryKind) {
  expect_refused(tar_block({.name = "s", .type = 'S'}) + tar_end(), {"upload"});
  expect_refused(
      pax_header(pax_record("GNU.sparse.major", "1") + pax_record("GNU.sparse.minor", "0") +
                 pax_record("GNU.sparse.realsize", "1099511627776")) +
          tar_file("s", "1\n0\n1\n") + tar_end(),
      {"upload"});
  expect_refused(pax_header(pax_record("GNU.sparse.map", "0,1,1099511627775,1")) +
                     tar_file("s", "xy") + tar_end(),
                 {"upload"});
  expect_refused(pax_header(pax_record("GNU.sparse.numblocks", "1") +
                            pax_record("GNU.sparse.offset", "1000000") +
                            pax_record("GNU.sparse.numbytes", "2")) +
                     tar_file("s", "xy") + tar_end(),
                 {"upload"});
  for (const std::string key : {"GNU.sparse.size", "GNU.sparse.realsize", "SCHILY.realsize"})
    for (const std::string size : {"1", "3", "1000000", "-1"})
      expect_refused(pax_header(pax_record(key, size)) + tar_file("s", "xy") + tar_end(),
                     {"upload"});
}

TEST_F(ArchiveAttackTest, RefusesSizesThatAreNotTrue) {
  const auto lying = [](std::uint64_t said, const std::string& bytes) {
    return tar_block({.name = "lie", .bytes = said}) + padded(bytes) + tar_file("next", "x") +
           tar_end();
  };
  expect_refused(lying(0, std::string(600, 'x')), {"upload"});
  expect_refused(lying(512, std::string(600, 'x')), {"upload"});
  expect_refused(lying(5000, std::string(600, 'x')), {"upload"});
  expect_refused(lying(077777777777, "x"), {"entry 'lie'", "8589934590 at most"},
                 {.file_bytes = 8589934590});
  for (const std::string& field :
       {std::string("\x80\0\0\0\x7f\xff\xff\xff\xff\xff\xff\xff", 12),
        std::string("\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff", 12),
        std::string("-1         "), std::string("777777777777")})
    expect_refused(tar_block({.name = "lie", .size_field = field}) + padded("x") + tar_end(),
                   {"upload"});
  for (const std::string size : {"0", "513", "9223372036854775807", "99999999999999999999", "-1"})
    expect_refused(pax_header(pax_record("size", size)) + tar_file("lie", "x") + tar_end(),
                   {"upload"});
  expect_refused(tar_block({.name = "d/", .bytes = 3, .type = '5'}) + padded("abc") + tar_end(),
                 {"upload"});
  expect_refused(pax_header(pax_record("size", "3")) + tar_folder("d/") + padded("abc") + tar_end(),
                 {"upload"});
}

TEST_F(ArchiveAttackTest, RefusesTwoThingsOfOneName) {
  const std::string file = tar_file("a", "x");
  const std::string folder = tar_folder("a/");
  expect_refused(file + file + tar_end(), {"entry 'a'", "twice"});
  expect_refused(file + tar_file("./a", "y") + tar_end(), {"twice"});
  expect_refused(folder + folder + tar_end(), {"twice"});
  expect_refused(file + folder + tar_end(), {"entry 'a'", "twice"});
  expect_refused(folder + file + tar_end(), {"a file", "a folder"});
  expect_refused(file + tar_file("a/b", "y") + tar_end(), {"entry 'a/b'", "in a file"});
  expect_refused(tar_file("a/b", "y") + file + tar_end(), {"a file", "a folder"});
  expect_refused(
      tar_file("a", "x") + pax_header(pax_record("path", "a")) + tar_file("b", "y") + tar_end(),
      {"twice"});
}

TEST_F(ArchiveAttackTest, RefusesDamagedAndOverlongHeaders) {
  std::string block = tar_file("a", "x");
  block[0] = 'b';
  expect_refused(block + tar_end(), {"upload"});
  expect_refused(tar_file("a", "x") + block + tar_end(), {"upload"});
  expect_refused(
      pax_header(pax_record("comment", std::string(20'000, 'c'))) + tar_file("a", "x") + tar_end(),
      {"8 KiB"});
  expect_refused(pax_header(pax_record("path", std::string("a\0/../../b", 10))) +
                     tar_file("a", "x") + tar_end(),
                 {"a NUL"});
  expect_refused(pax_header("7 broken") + tar_file("a", "x") + tar_end(), {"upload"});
  std::string headers;
  for (int i = 0; i < 40; ++i) headers += pax_header(pax_record("comment", "c"), i % 2 ? 'x' : 'g');
  expect_refused(headers + tar_file("a", "x") + tar_end(), {"upload"});
  expect_refused("no tar at all", {"upload"});
  expect_refused("", {"nothing"});
  expect_refused(std::string(4096, 'x'), {"upload"});
}

TEST_F(ArchiveAttackTest, RefusesWhatLiesBehindTheEnd) {
  const std::string tar = tar_file("a", "x") + tar_end();
  expect_refused(tar + tar_file("b", "y") + tar_end(), {"behind its end"});
  expect_refused(tar + "x", {"behind its end"});
  expect_refused(tar_file("a", "x") + std::string(512, '\0') + tar_file("b", "y") + tar_end(),
                 {"end"});
  for (const Packing packing : {Packing::kGzip, Packing::kZstd}) {
    expect_refused(packed(tar, packing) + "x", {"upload"});
    expect_refused(packed(tar, packing) + std::string(100'000, '\0'), {"upload"});
    expect_refused(packed(tar + tar, packing), {"behind its end"});
    expect_refused(packed(tar, packing) + packed(tar, packing), {"behind its end"});
    expect_refused(packed(packed(tar, packing), Packing::kGzip), {"more than once"});
    expect_refused(packed(packed(tar, packing), Packing::kZstd), {"more than once"});
  }
  // As tar pads it.
  extract_archive({source_of(tar + std::string(10'240, '\0')), "upload"}, target_, calls_);
}

TEST_F(ArchiveAttackTest, RefusesWhatIsCutAnywhere) {
  const std::string tar = pax_header(pax_record("path", "p")) + tar_file("a", "0123456789") +
                          tar_folder("d/") + tar_file("d/e", std::string(700, 'x')) + tar_end();
  for (const Packing packing : {Packing::kNone, Packing::kGzip, Packing::kZstd}) {
    const std::string bytes = packed(tar, packing);
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      try {
        extract_archive({source_of(bytes.substr(0, size)), "upload"}, target_, calls_);
        ADD_FAILURE() << size << " of " << bytes.size() << " bytes were taken";
      } catch (const maps::InputError&) {
      }
      ASSERT_FALSE(fs::exists(target_));
    }
  }
}

TEST_F(ArchiveAttackTest, KeepsEveryLimit) {
  const std::string two = tar_file("a", "0123456789") + tar_file("b/c/d", "0123456789") + tar_end();
  extract_archive(
      {source_of(two),
       "upload",
       {.entries = 4, .file_bytes = 10, .total_bytes = two.size(), .path_bytes = 5, .depth = 3}},
      target_, calls_);
  fs::remove_all(target_);
  expect_refused(two, {"more entries", "3 at most"}, {.entries = 3});
  expect_refused(two, {"more entries than the memory holds"}, {.list_bytes = 400});
  expect_refused(two, {"entry 'a'", "10 bytes", "9 at most"}, {.file_bytes = 9});
  expect_refused(two, {"unpacked"}, {.total_bytes = two.size() - 1});
  expect_refused(two, {"5 bytes", "4 at most"}, {.path_bytes = 4});
  expect_refused(two, {"3 parts", "2 at most"}, {.depth = 2});
  expect_refused(tar_file("n/" + std::string(40, 'n'), "") +
                     pax_header(pax_record("path", std::string(256, 'n'))) + tar_file("a", "") +
                     tar_end(),
                 {"255 at most"}, {.path_bytes = 1000});
  for (const double ratio : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(extract_archive({source_of(two), "upload", {.ratio = ratio}}, target_, calls_),
                 std::invalid_argument);
  expect_nothing_left();
}

TEST_F(ArchiveAttackTest, RefusesBombsEarly) {
  const std::string bomb =
      tar_block({.name = "zeros", .bytes = 18U << 20U}) + std::string(18U << 20U, '\0') + tar_end();
  for (const Packing packing : {Packing::kGzip, Packing::kZstd})
    expect_refused(packed(bomb, packing), {"bytes out of", "times as many"});
  // Behind the end as well, where nothing is written.
  expect_refused(packed(tar_end() + std::string(18U << 20U, '\0'), Packing::kZstd),
                 {"bytes out of"});
}

TEST_F(ArchiveAttackTest, RefusesAHundredThousandEntriesAtTheLimit) {
  std::size_t entries = 0;
  std::string header;
  const ByteSource source = [&](std::span<char> into) {
    if (header.empty()) header = tar_folder(std::to_string(entries++) + "/");
    const std::size_t size = std::min(into.size(), header.size());
    std::copy_n(header.begin(), size, into.begin());
    header.erase(0, size);
    return entries > 100'000 ? 0 : size;
  };
  EXPECT_THAT(
      [&] {
        extract_archive({source, "upload", {.entries = 500}}, target_, calls_);
      },
      ThrowsSaying<maps::InputError>({"more entries", "500 at most"}));
  EXPECT_LT(entries, 2000U);
  expect_nothing_left();
}

}  // namespace archive_attack_test
}  // namespace stillmap::server
