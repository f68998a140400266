#pragma once

#include "errors/api_error.hpp"

#include <stillmap/maps/error.hpp>

#include <filesystem>
#include <string>
#include <type_traits>
#include <utility>

namespace stillmap::server {

class PackageStore;

/// A message without the store's own place on this machine, and without where in it an upload or
/// the work of a job lies: of "FOLDER/drives/12/drive-12/scans/1.bin" the client knows
/// "scans/1.bin".
[[nodiscard]] std::string without_folder(std::string text, const std::filesystem::path& folder);

/// The same of a store, whose packages may be elsewhere: without where they are, too.
[[nodiscard]] std::string without_places(std::string text, const PackageStore& store);

/// Runs what reads an upload: what is wrong with its bytes is the client's to know.
/// @throws ApiError kInvalidUpload in place of InputError.
template <typename Work>
[[nodiscard]] std::invoke_result_t<Work> with_upload_errors(const std::filesystem::path& folder,
                                                            Work&& work) {
  try {
    return std::forward<Work>(work)();
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidUpload, without_folder(error.what(), folder));
  }
}

/// The same of a package.
template <typename Work>
[[nodiscard]] std::invoke_result_t<Work> with_upload_errors(const PackageStore& store,
                                                            Work&& work) {
  try {
    return std::forward<Work>(work)();
  } catch (const maps::InputError& error) {
    throw ApiError(ErrorCode::kInvalidUpload, without_places(error.what(), store));
  }
}

}  // namespace stillmap::server
