#include "web_assets.hpp"

#include "http/gzip.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <fstream>
#include <iterator>
#include <string_view>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// @return empty for what is no part of a web page.
std::string_view content_type_of(const fs::path& file) {
  static constexpr std::array<std::pair<std::string_view, std::string_view>, 12> kTypes = {{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".map", "application/json"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".jpg", "image/jpeg"},
      {".ico", "image/x-icon"},
      {".woff2", "font/woff2"},
      {".wasm", "application/wasm"},
      {".webmanifest", "application/manifest+json"},
  }};
  for (const auto& [extension, type] : kTypes) {
    if (file.extension() == extension) return type;
  }
  return {};
}

std::string read_file(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (!stream) throw maps::StorageError(file.string(), "cannot be read");
  return bytes;
}

void add_asset(const fs::directory_entry& entry, const std::string& name,
               std::vector<WebAsset>& assets) {
  const std::string_view type = content_type_of(entry.path());
  if (entry.is_symlink() || !entry.is_regular_file() || type.empty()) return;
  WebAsset asset{.path = name == "index.html" ? "/" : "/" + name,
                 .content_type = std::string(type),
                 .body = std::make_shared<const std::string>(read_file(entry.path())),
                 .packed = {},
                 .hashed = name.starts_with("assets/")};
  std::string packed = pack_gzip(*asset.body);
  if (packed.size() < asset.body->size())
    asset.packed = std::make_shared<const std::string>(std::move(packed));
  assets.push_back(std::move(asset));
}

}  // namespace

std::vector<WebAsset> read_web_assets(const fs::path& folder) {
  std::vector<WebAsset> assets;
  if (!fs::is_directory(folder)) return assets;
  try {
    for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
      add_asset(entry, entry.path().filename().string(), assets);
    }
    if (fs::is_directory(folder / "assets")) {
      for (const fs::directory_entry& entry : fs::directory_iterator(folder / "assets")) {
        add_asset(entry, "assets/" + entry.path().filename().string(), assets);
      }
    }
  } catch (const fs::filesystem_error& error) {
    throw maps::StorageError(folder.string(), error.code().message());
  }
  return assets;
}

}  // namespace stillmap::server
