#pragma once

#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <string_view>

// OpenSSL's own name, so that its headers stay in ed25519.cpp.
struct evp_pkey_st;

namespace stillmap::server {

/// A public key as 64 digits of hex: its 32 bytes (RFC 8032). It is its own name.
using PublicKey = std::string;
using PublicKeys = std::set<PublicKey>;

/// An Ed25519 key that signs.
class SigningKey {
 public:
  /// Of the system's random bits.
  [[nodiscard]] static SigningKey make();
  /// @param file  PEM (PKCS #8), without a pass phrase. @throws maps::InputError.
  [[nodiscard]] static SigningKey read(const std::filesystem::path& file);

  /// Makes a file that its owner alone may read. @throws maps::InputError when there is one
  /// already, maps::StorageError.
  void write(const std::filesystem::path& file) const;
  /// Makes a file of the public key in PEM. @throws as `write`.
  void write_public(const std::filesystem::path& file) const;
  [[nodiscard]] PublicKey public_key() const;
  /// @return 128 digits of hex.
  [[nodiscard]] std::string sign(std::string_view text) const;

 private:
  explicit SigningKey(std::shared_ptr<evp_pkey_st> key) : key_(std::move(key)) {}
  std::shared_ptr<evp_pkey_st> key_;
};

/// @param file  one Ed25519 key or several, each in PEM, one behind the other.
/// @throws maps::InputError when there is none, or another kind of key.
[[nodiscard]] PublicKeys read_public_keys(const std::filesystem::path& file);

/// Whether it is the signature of the text by this key; texts that are no key and no signature are
/// none.
[[nodiscard]] bool is_signature(std::string_view signature, std::string_view text,
                                const PublicKey& key);

}  // namespace stillmap::server
