#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/point_fates.hpp>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace point_fates_test {

using test::ThrowsSaying;

ScanFates mixed(std::size_t points) {
  ScanFates scan;
  scan.resize(points);
  for (std::size_t i = 0; i < points; ++i) {
    scan.fates[i] = static_cast<PointFate>(i / 7 % kPointFates);
    const bool moved =
        scan.fates[i] == PointFate::kProjected || scan.fates[i] == PointFate::kDeleted;
    scan.objects[i] = moved ? static_cast<std::uint32_t>(i * 1'000'003 / 30) : 0;
  }
  return scan;
}

class PointFates : public testing::Test {
 protected:
  PointFates() {
    FatesWriter writer(file_);
    for (const ScanFates& scan : scans_) writer.add(scan);
    writer.finish();
  }
  std::string bytes() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void write(const std::string& bytes) const {
    std::ofstream(file_, std::ios::binary | std::ios::trunc) << bytes;
  }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "fates.bin";
  std::vector<ScanFates> scans_{mixed(1000), ScanFates{}, mixed(1), mixed(100'000)};
};

TEST_F(PointFates, ReadBackScanByScan) {
  for (std::size_t scan = 0; scan < scans_.size(); ++scan)
    EXPECT_EQ(read_fates(file_, scan), scans_[scan]) << scan;
}

TEST_F(PointFates, OfLongRunsTakeFewBytes) {
  ScanFates scan;
  scan.resize(120'000);
  scan.fates.assign(120'000, PointFate::kGround);
  FatesWriter writer(file_);
  writer.add(scan);
  writer.finish();
  EXPECT_LT(std::filesystem::file_size(file_), 64U);
  EXPECT_EQ(read_fates(file_, 0), scan);
}

TEST_F(PointFates, RefuseAScanBeyondTheFile) {
  EXPECT_THAT([&] { (void)read_fates(file_, 4); },
              ThrowsSaying<InputError>({"fates.bin", "4 scans", "more than 4"}));
}

TEST_F(PointFates, RefuseListsOfDifferentLength) {
  ScanFates scan = mixed(3);
  scan.objects.pop_back();
  FatesWriter writer(file_);
  EXPECT_THROW(writer.add(scan), std::invalid_argument);
}

TEST_F(PointFates, RefuseAnyTruncation) {
  const std::string whole = bytes();
  for (const std::size_t left : {0UL, 7UL, 8UL, 24UL, whole.size() / 2, whole.size() - 1}) {
    write(whole.substr(0, left));
    EXPECT_THROW((void)read_fates(file_, 0), InputError) << left;
  }
}

TEST_F(PointFates, NeverReadBeyondTheirBytesWhateverIsFlipped) {
  FatesWriter writer(file_);
  writer.add(mixed(40));
  writer.finish();
  const std::string whole = bytes();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const int bit : {0, 3, 7}) {
      std::string broken = whole;
      broken[at] = static_cast<char>(broken[at] ^ (1 << bit));
      write(broken);
      try {
        EXPECT_LE(read_fates(file_, 0).size(), 1U << 26U);
      } catch (const InputError&) {
        // Refused is as good.
      }
    }
  }
}

}  // namespace point_fates_test
}  // namespace stillmap::maps
