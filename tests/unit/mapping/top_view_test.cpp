#include "core/top_view.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <stillmap/maps/error.hpp>

#include <limits>

#include "support/temporary_folder.hpp"

namespace stillmap::mapping {
namespace top_view_test {

constexpr Colour kDark{18, 20, 26};
constexpr Colour kLowest{68, 1, 84};
constexpr Colour kHighest{253, 231, 37};
constexpr Colour kRed{255, 0, 0};

/// 10 x 5 m at 2 pixels a metre.
TopView small_view() { return {{0.0, 0.0}, {10.0, 5.0}, 20}; }

Colour pixel(const TopView& view, int column, int row) {
  return view.render().at(static_cast<std::size_t>(row * view.width() + column));
}

TEST(TopView, HasTheShapeOfItsArea) {
  EXPECT_EQ(small_view().width(), 20);
  EXPECT_EQ(small_view().height(), 10);
  const TopView tall({0.0, 0.0}, {1.0, 4.0}, 16);
  EXPECT_EQ(tall.width(), 4);
  EXPECT_EQ(tall.height(), 16);
}

TEST(TopView, PutsXToTheRightAndYUp) {
  TopView view = small_view();
  view.add_point({0.25, 0.25, 0.0});
  view.add_point({9.75, 4.75, 1.0});
  EXPECT_EQ(pixel(view, 0, 9), kLowest);
  EXPECT_NE(pixel(view, 19, 0), kDark);
  EXPECT_EQ(pixel(view, 0, 0), kDark);
  EXPECT_EQ(pixel(view, 19, 9), kDark);
}

TEST(TopView, ColoursAPixelByItsHighestPoint) {
  TopView view = small_view();
  view.add_point({1.1, 1.1, 3.0});
  view.add_point({1.1, 1.1, 1.0});
  view.add_point({3.1, 1.1, 1.0});
  view.add_point({5.1, 1.1, 3.0});
  EXPECT_EQ(pixel(view, 2, 7), kHighest);
  EXPECT_EQ(pixel(view, 6, 7), kLowest);
  EXPECT_EQ(pixel(view, 10, 7), kHighest);
}

TEST(TopView, LeavesOutWhatIsOutsideOrNotFinite) {
  TopView view = small_view();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  view.add_point({-0.1, 1.0, 0.0});
  view.add_point({10.1, 1.0, 0.0});
  view.add_point({1.0, 5.1, 0.0});
  view.add_point({1e30, 1.0, 0.0});
  view.add_point({nan, 1.0, 0.0});
  view.add_line({nan, 0.0}, {1.0, 1.0}, kRed);
  view.add_line({0.0, 0.0}, {1e9, 1e9}, kRed);
  EXPECT_THAT(view.render(), ::testing::Each(kDark));
}

TEST(TopView, DrawsLinesOverPoints) {
  TopView view = small_view();
  view.add_point({2.25, 2.25, 0.0});
  view.add_line({0.25, 2.25}, {4.75, 2.25}, kRed);
  for (int column = 0; column <= 9; ++column) EXPECT_EQ(pixel(view, column, 5), kRed);
  EXPECT_EQ(pixel(view, 10, 5), kDark);
}

TEST(TopView, DrawsABoxOfAnotherFrame) {
  TopView view = small_view();
  maps::Box box;
  box.centre = {1.0, 0.0, 0.0};
  box.size_m = {4.0, 2.0, 1.5};
  Eigen::Isometry3d T_a_b = Eigen::Isometry3d::Identity();
  T_a_b.translation() = Eigen::Vector3d(4.1, 2.6, 0.0);
  view.add_box(box, T_a_b, kRed);
  // x from 3.1 to 7.1, y from 1.6 to 3.6.
  for (const int column : {6, 10, 14}) {
    EXPECT_EQ(pixel(view, column, 6), kRed);
    EXPECT_EQ(pixel(view, column, 2), kRed);
  }
  EXPECT_EQ(pixel(view, 6, 4), kRed);
  EXPECT_EQ(pixel(view, 14, 4), kRed);
  EXPECT_EQ(pixel(view, 10, 4), kDark);
  EXPECT_EQ(pixel(view, 15, 4), kDark);
}

TEST(TopView, WritesAPngThatReadsBackPixelByPixel) {
  const test::TemporaryFolder folder;
  TopView view = small_view();
  view.add_point({1.1, 1.1, 3.0});
  view.add_line({0.0, 4.0}, {9.0, 4.0}, kRed);
  const std::filesystem::path file = folder.path() / "view.png";
  view.write_png(file);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  ASSERT_NE(png_image_begin_read_from_file(&png, file.c_str()), 0) << png.message;
  png.format = PNG_FORMAT_RGB;
  ASSERT_EQ(png.width, 20U);
  ASSERT_EQ(png.height, 10U);
  std::vector<Colour> read(200);
  ASSERT_NE(png_image_finish_read(&png, nullptr, read.data(), 0, nullptr), 0) << png.message;
  EXPECT_EQ(read, view.render());
}

TEST(TopView, NamesAFileThatCannotBeWritten) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(small_view().write_png(folder.path() / "none" / "view.png"), maps::StorageError);
}

TEST(TopView, RefusesAnAreaOrASizeThatIsNone) {
  EXPECT_THROW(TopView({0.0, 0.0}, {0.0, 5.0}, 20), std::invalid_argument);
  EXPECT_THROW(TopView({0.0, 0.0}, {1.0, std::numeric_limits<double>::quiet_NaN()}, 20),
               std::invalid_argument);
  EXPECT_THROW(TopView({0.0, 0.0}, {1.0, 1.0}, 15), std::invalid_argument);
  EXPECT_THROW(TopView({0.0, 0.0}, {1.0, 1.0}, 8193), std::invalid_argument);
}

}  // namespace top_view_test
}  // namespace stillmap::mapping
