#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "signing/ed25519.hpp"

namespace stillmap::server {

/// Says that the holder of a key vouches for a package as a version of a map.
struct MapSignature {
  PublicKey key{};
  /// 128 digits of hex.
  std::string signature{};
  auto operator<=>(const MapSignature&) const = default;
};

/// Most signatures of one version.
inline constexpr std::size_t kMostSignatures = 16;
/// In a package's folder, beside its manifest: signatures that go with it into a store.
inline constexpr const char* kSignaturesName = "signatures.json";
/// Of that file, and of a request.
inline constexpr std::size_t kMostSignaturesBytes = std::size_t{16} << 10U;

/// @param digest  of the package: SHA-256 of its manifest, hex, which stands for all of its bytes.
/// The map's name is signed too, so that no map is taken for another one.
[[nodiscard]] MapSignature sign_map(const SigningKey& key, std::string_view map,
                                    std::string_view digest);
[[nodiscard]] bool is_signature_of(const MapSignature& signature, std::string_view map,
                                   std::string_view digest);
/// Whether one of them is good and by one of the keys.
[[nodiscard]] bool is_signed_by(const PublicKeys& keys, const std::vector<MapSignature>& signatures,
                                std::string_view map, std::string_view digest);

/// {"signatures": [{"key": …, "signature": …}, …]}
[[nodiscard]] std::string signatures_text(const std::vector<MapSignature>& signatures);
/// @param name  of the text, for messages. @throws maps::InputError.
[[nodiscard]] std::vector<MapSignature> parse_signatures(std::string_view text,
                                                         const std::string& name);
/// Those beside the manifest of a package; none where there is no such file.
/// @throws maps::InputError.
[[nodiscard]] std::vector<MapSignature> signatures_beside(const std::filesystem::path& package);
/// Adds one to those beside the manifest of a package, in place of that by the same key.
/// @throws maps::InputError, maps::StorageError.
void add_signature_beside(const std::filesystem::path& package, const MapSignature& signature);

}  // namespace stillmap::server
