#pragma once

#include "handlers/context.hpp"

#include "store/archive.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace stillmap::server {

/// Bytes that are to become a version of a map.
struct Publication {
  /// Names that `check_name` let through.
  std::string map;
  std::string version;
  /// `check_publication_type` let it through.
  std::string content_type;
  /// Key of who sends them.
  std::string key_id;
  ByteSource source;
  std::uint64_t bytes = 0;
  /// Of the bytes, where that is known.
  std::optional<std::string> sha256{};
};

/// An archive of a package, or a PCD or PLY map. Empty counts as an archive.
/// @throws ApiError kUnsupportedMediaType naming the field.
void check_publication_type(const std::string& field, const std::string& media_type);

/// Publishes a package: 201, or 200 when the same is there; has a cloud converted: 202, or 200 when
/// that was done before. @throws ApiError kInvalidUpload; StoreRefusal.
[[nodiscard]] HttpResponse publish(const Context& context, const Publication& wanted);
/// The same, but what is wrong with the bytes is thrown as it is. @throws InputError.
[[nodiscard]] HttpResponse publish_bytes(const Context& context, const Publication& wanted);

}  // namespace stillmap::server
