#include "top_view.hpp"

#include <fmt/format.h>
#include <png.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr Colour kBackground{18, 20, 26};

/// Stops of a perceptually even scale (viridis), low to high.
constexpr std::array<Colour, 5> kScale = {
    {{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}}};

[[nodiscard]] Colour scale_at(double share) {
  const double place = std::clamp(share, 0.0, 1.0) * (kScale.size() - 1);
  const std::size_t low = std::min(static_cast<std::size_t>(place), kScale.size() - 2);
  const double t = place - static_cast<double>(low);
  const auto mix = [t](std::uint8_t a, std::uint8_t b) {
    return static_cast<std::uint8_t>(std::lround((1.0 - t) * a + t * b));
  };
  const Colour& a = kScale[low];
  const Colour& b = kScale[low + 1];
  return {mix(a.red, b.red), mix(a.green, b.green), mix(a.blue, b.blue)};
}

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

}  // namespace

TopView TopView::of_tiles(const std::vector<maps::TileId>& tiles) {
  constexpr int kSide = 1600;
  // Of whole tiles: what is in them need not be known.
  Eigen::AlignedBox2d box;
  for (const maps::TileId id : tiles) {
    const Eigen::Vector2d corner(id.x * maps::kTileSizeM, id.y * maps::kTileSizeM);
    box.extend(corner);
    box.extend(corner + Eigen::Vector2d::Constant(maps::kTileSizeM));
  }
  return {box.min(), box.max(), kSide};
}

TopView::TopView(const Eigen::Vector2d& min, const Eigen::Vector2d& max, int longest_side)
    : min_(min) {
  const Eigen::Vector2d extent = max - min;
  const bool usable = extent.allFinite() && (extent.array() > 0.0).all();
  if (!usable || longest_side < 16 || longest_side > 8192) {
    throw std::invalid_argument(
        fmt::format("top view: {} m x {} m on {} pixels, expected an area and 16 to 8192 pixels",
                    extent.x(), extent.y(), longest_side));
  }
  pixels_per_m_ = longest_side / extent.maxCoeff();
  width_ = std::max(1, static_cast<int>(std::ceil(extent.x() * pixels_per_m_ - 1e-9)));
  height_ = std::max(1, static_cast<int>(std::ceil(extent.y() * pixels_per_m_ - 1e-9)));
  tops_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
               std::numeric_limits<float>::quiet_NaN());
}

std::array<int, 2> TopView::pixel_of(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d px = (p - min_) * pixels_per_m_;
  const auto bounded = [](double v) {
    return static_cast<int>(std::clamp(std::floor(v), -1e6, 1e6));
  };
  return {bounded(px.x()), height_ - 1 - bounded(px.y())};
}

void TopView::add_point(const Eigen::Vector3d& p) {
  if (!p.allFinite()) return;
  const auto pixel = pixel_of(p.head<2>());
  if (!is_inside(pixel)) return;
  float& top = tops_[index_of(pixel)];
  const auto z = static_cast<float>(p.z());
  if (!(top >= z)) top = z;
}

void TopView::add_line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, Colour colour) {
  if (!a.allFinite() || !b.allFinite()) return;
  lines_.push_back({pixel_of(a), pixel_of(b), colour});
}

void TopView::add_box(const maps::Box& box, const Eigen::Isometry3d& T_a_b, Colour colour) {
  const Eigen::Vector2d forward(std::cos(box.yaw_rad), std::sin(box.yaw_rad));
  const Eigen::Vector2d left(-forward.y(), forward.x());
  const auto corner = [&](double along, double across) {
    Eigen::Vector3d p = box.centre;
    p.head<2>() += 0.5 * along * box.size_m.x() * forward + 0.5 * across * box.size_m.y() * left;
    return Eigen::Vector2d((T_a_b * p).head<2>());
  };
  constexpr std::array<std::array<double, 2>, 5> kRound = {
      {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}, {1, 1}}};
  for (std::size_t i = 0; i + 1 < kRound.size(); ++i) {
    add_line(corner(kRound[i][0], kRound[i][1]), corner(kRound[i + 1][0], kRound[i + 1][1]),
             colour);
  }
}

void TopView::draw(const Line& line, std::vector<Colour>& image) const {
  const int steps =
      std::max({1, std::abs(line.to[0] - line.from[0]), std::abs(line.to[1] - line.from[1])});
  // A line that runs far out of the picture is left out, so that a wild box costs nothing.
  if (steps > 4 * (width_ + height_)) return;
  for (int s = 0; s <= steps; ++s) {
    const double t = static_cast<double>(s) / steps;
    const std::array<int, 2> pixel = {
        static_cast<int>(std::lround(line.from[0] + t * (line.to[0] - line.from[0]))),
        static_cast<int>(std::lround(line.from[1] + t * (line.to[1] - line.from[1])))};
    if (is_inside(pixel)) image[index_of(pixel)] = line.colour;
  }
}

std::vector<Colour> TopView::render() const {
  std::vector<float> sorted;
  for (const float top : tops_) {
    if (!std::isnan(top)) sorted.push_back(top);
  }
  std::sort(sorted.begin(), sorted.end());
  const auto percentile = [&](std::size_t percent) {
    return sorted.empty() ? 0.0 : static_cast<double>(sorted[(sorted.size() - 1) * percent / 100]);
  };
  const double low = percentile(2);
  const double span = std::max(percentile(98) - low, 1e-6);

  std::vector<Colour> image(tops_.size(), kBackground);
  for (std::size_t i = 0; i < tops_.size(); ++i) {
    if (!std::isnan(tops_[i])) image[i] = scale_at((static_cast<double>(tops_[i]) - low) / span);
  }
  for (const Line& line : lines_) draw(line, image);
  return image;
}

std::string TopView::png() const {
  const std::vector<Colour> image = render();
  static_assert(sizeof(Colour) == 3);
  // The simplified interface of libpng has no longjmp, which would skip destructors.
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width_);
  png.height = static_cast<png_uint_32>(height_);
  png.format = PNG_FORMAT_RGB;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, image.data(), 0, nullptr) == 0)
    throw maps::StorageError("picture", png.message);
  bytes.resize(size);
  return bytes;
}

void TopView::write_png(const std::filesystem::path& file) const {
  const std::string bytes = png();
  const std::unique_ptr<std::FILE, FileCloser> out(std::fopen(file.c_str(), "wb"));
  if (!out) throw maps::StorageError(file.string(), std::strerror(errno));
  if (std::fwrite(bytes.data(), 1, bytes.size(), out.get()) != bytes.size() ||
      std::fflush(out.get()) != 0)
    throw maps::StorageError(file.string(), std::strerror(errno));
}

}  // namespace stillmap::mapping
