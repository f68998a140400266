#include <stillmap/maps/layer_file.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace layer_file_test {

using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;

class LayerFileTest : public ::testing::Test {
 protected:
  static TileLayer sample() {
    TileLayer layer{.cells_per_side = 2, .tiles = {{0, -1, 3}, {0, 4, -5}}, .bands = {}};
    layer.bands = {{.name = "height", .unit = "m", .values = {1, 2, 3, 4, 5, 6, 7, 8}},
                   {.name = "scans", .unit = "", .values = {0, 0, 0, 0, 0, 0, 0, 9}}};
    layer.bands[0].values[2] = std::numeric_limits<float>::quiet_NaN();
    return layer;
  }
  std::string bytes() const {
    std::ifstream in(file_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void put(const std::string& bytes) const { std::ofstream(file_, std::ios::binary) << bytes; }

  TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "layers" / "coverage.layer";
  std::string digest_ = std::string(64, 'a');
};

TEST_F(LayerFileTest, ComesBackAsItWasWritten) {
  write_layer(file_, digest_, sample());
  const TileLayer back = read_layer(file_, digest_);
  EXPECT_EQ(back.cells_per_side, 2U);
  EXPECT_EQ(back.tiles, sample().tiles);
  ASSERT_EQ(back.bands.size(), 2U);
  EXPECT_EQ(back.bands[0].name, "height");
  EXPECT_EQ(back.bands[0].unit, "m");
  EXPECT_TRUE(std::isnan(back.bands[0].values[2]));
  EXPECT_EQ(back.bands[1].values, sample().bands[1].values);
}

TEST_F(LayerFileTest, EveryChangedAndEveryMissingByteIsFound) {
  write_layer(file_, digest_, sample());
  const std::string whole = bytes();
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    put(damaged);
    EXPECT_THROW((void)read_layer(file_, digest_), InputError) << i;
    put(whole.substr(0, i));
    EXPECT_THROW((void)read_layer(file_, digest_), InputError) << i;
  }
  put(whole + "x");
  EXPECT_THROW((void)read_layer(file_, digest_), InputError);
}

TEST_F(LayerFileTest, OfAnotherMapOrNoneAreRefused) {
  write_layer(file_, digest_, sample());
  EXPECT_THAT([&] { (void)read_layer(file_, std::string(64, 'b')); },
              ThrowsSaying<InputError>({"coverage.layer", "another map"}));
  EXPECT_THAT([&] { (void)read_layer(folder_.path() / "none", digest_); },
              ThrowsSaying<StorageError>({"none"}));
}

TEST_F(LayerFileTest, LayersThatDoNotFitThemselvesAreNotWritten) {
  TileLayer layer = sample();
  layer.bands[1].values.pop_back();
  EXPECT_THROW(write_layer(file_, digest_, layer), std::invalid_argument);
  layer = sample();
  layer.bands[0].name = std::string(24, 'x');
  EXPECT_THROW(write_layer(file_, digest_, layer), std::invalid_argument);
  EXPECT_THROW(write_layer(file_, "short", sample()), std::invalid_argument);
}

}  // namespace layer_file_test
}  // namespace stillmap::maps
