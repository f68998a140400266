#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::server {

/// One file of the web page, as it is sent.
struct WebAsset {
  /// Such as `/assets/index-4f2a.js`; `/` for index.html.
  std::string path;
  std::string content_type;
  /// Each connection sends from these bytes, so that many at one time take no more memory than one.
  std::shared_ptr<const std::string> body;
  /// The same in gzip; null where that saves nothing.
  std::shared_ptr<const std::string> packed;
  /// Its name changes with its content, so clients may keep it for ever.
  bool hashed = false;
};

/// Reads every regular file below a folder; links are not followed. A request's path is only
/// compared with the list.
/// @return empty when the folder does not exist.
/// @throws maps::StorageError when it cannot be read.
[[nodiscard]] std::vector<WebAsset> read_web_assets(const std::filesystem::path& folder);

}  // namespace stillmap::server
