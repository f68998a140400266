#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace stillmap::server {

/// 32 random bytes that only the servers of one store know. Wiped when it is dropped.
class SealKey {
 public:
  static constexpr std::size_t kBytes = 32;

  /// @throws std::runtime_error when the system gives no random bytes.
  static SealKey make();
  /// @param hex  64 lower-case digits. @return nothing for any other text.
  static std::optional<SealKey> from_hex(std::string_view hex);
  SealKey(const SealKey&) = default;
  SealKey& operator=(const SealKey&) = default;
  ~SealKey();

  /// For the file that keeps it: never log it.
  [[nodiscard]] std::string hex() const;
  [[nodiscard]] std::span<const unsigned char> bytes() const { return bytes_; }

 private:
  SealKey() = default;
  std::array<unsigned char, kBytes> bytes_{};
};

/// What a vehicle carries from one scan of a sealed session to the next.
struct SealedSession {
  static constexpr std::size_t kIdBytes = 16;

  /// Random bytes, the same in all seals of a session.
  std::string id;
  /// Seals of the session before this one, on this line of answers.
  std::uint64_t count = 0;
  /// By the clock of the server that made it.
  std::int64_t made_ns = 0;
  /// What it is tracked in. The map is told in a set only: else the owner tells it. The digest is
  /// 64 hex digits.
  std::string map;
  std::string version;
  std::string digest;
  /// As it began: label of the vehicle, whether the version was named, or came with a roll-out.
  std::string vehicle;
  bool version_was_named = false;
  bool is_rolled_out = false;
  /// `localization::Tracker::state`.
  std::string tracker;
};

/// Whom a seal is made for. It is not in the seal: the request says it, and must say the same.
struct SealOwner {
  /// Public id of the API key; empty without keys.
  std::string_view key_id;
  /// Of a session in a set "set/" and its name, which no map is called.
  std::string map;
};

/// Longest text of a seal.
inline constexpr std::size_t kMaxSealText = 2416;

/// Encrypts and authenticates a session (server/decisions/a_key_for_each_seal.md).
/// @return base64, at most `kMaxSealText`; two seals of the same session differ.
/// @throws std::runtime_error when OpenSSL or the system's random numbers fail.
[[nodiscard]] std::string seal(const SealedSession& session, const SealOwner& owner,
                               const SealKey& key);
/// @return nothing for what is no seal, was changed, or was made with another key or for another
/// owner; which of these is not told.
[[nodiscard]] std::optional<SealedSession> open_seal(std::string_view text, const SealOwner& owner,
                                                     const SealKey& key);

}  // namespace stillmap::server
