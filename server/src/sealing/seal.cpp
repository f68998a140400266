#include "sealing/seal.hpp"

#include "http/base64.hpp"
#include "store/store_folder.hpp"

#include <openssl/core_names.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/kdf.h>
#include <openssl/rand.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

namespace stillmap::server {
namespace {

using Cipher = std::unique_ptr<EVP_CIPHER_CTX, decltype(&EVP_CIPHER_CTX_free)>;
using Kdf = std::unique_ptr<EVP_KDF, decltype(&EVP_KDF_free)>;
using KdfContext = std::unique_ptr<EVP_KDF_CTX, decltype(&EVP_KDF_CTX_free)>;
using KeyBytes = std::array<unsigned char, SealKey::kBytes>;

/// The parts of a seal, in their order: format, id, fresh bytes, count, digest; then what is
/// encrypted, and the tag.
constexpr char kFormat = 1;
constexpr std::size_t kFreshBytes = 24, kCountBytes = 8, kDigestBytes = 32, kTagBytes = 16;
constexpr std::size_t kHeadBytes =
    1 + SealedSession::kIdBytes + kFreshBytes + kCountBytes + kDigestBytes;
constexpr std::size_t kNonceBytes = 12;
/// Of the byte of flags in what is encrypted.
constexpr unsigned char kNamed = 1, kRolledOut = 2, kInSet = 4;

[[noreturn]] void openssl_failed(const char* what) {
  ERR_clear_error();
  throw std::runtime_error(std::string("OpenSSL: ") + what);
}

unsigned char* to_write(std::string& bytes) {
  return reinterpret_cast<unsigned char*>(bytes.data());
}
const unsigned char* to_read(std::string_view bytes) {
  return reinterpret_cast<const unsigned char*>(bytes.data());
}

std::string random_bytes(std::size_t count) {
  std::string bytes(count, '\0');
  if (RAND_bytes(to_write(bytes), static_cast<int>(count)) != 1)
    openssl_failed("there is no randomness to make a seal of");
  return bytes;
}

void put_number(std::string& bytes, std::uint64_t value) {
  for (int shift = 56; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 0xffU);
}

void put_text(std::string& bytes, std::string_view text) {
  constexpr std::size_t kMost = 255;
  if (text.size() > kMost) throw std::invalid_argument("seal: a text of more than 255 bytes");
  bytes += static_cast<char>(text.size());
  bytes += text;
}

std::string bytes_of_hex(std::string_view hex) {
  const auto digit = [](char c) { return c <= '9' ? c - '0' : c - 'a' + 10; };
  std::string bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes += static_cast<char>(16 * digit(hex[i]) + digit(hex[i + 1]));
  return bytes;
}

std::string hex_of_bytes(std::string_view bytes) {
  std::string hex;
  for (const char each : bytes) hex += fmt::format("{:02x}", static_cast<unsigned char>(each));
  return hex;
}

/// Takes from the front of bytes; what is missing makes it `failed`.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : rest_(bytes) {}

  std::string_view take(std::size_t count) {
    if (rest_.size() < count) {
      failed_ = true;
      rest_ = {};
      return {};
    }
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }
  std::uint64_t number() {
    std::uint64_t value = 0;
    for (const char each : take(8)) value = value << 8U | static_cast<unsigned char>(each);
    return value;
  }
  unsigned char byte() {
    const std::string_view taken = take(1);
    return taken.empty() ? 0 : static_cast<unsigned char>(taken.front());
  }
  std::string text() { return std::string(take(byte())); }
  std::string_view rest() { return take(rest_.size()); }
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  std::string_view rest_;
  bool failed_ = false;
};

/// HKDF-SHA256 (RFC 5869): the session's id is the salt, so that extracting gives the session's
/// key; the fresh bytes are part of the info, so that expanding gives one for this seal alone.
KeyBytes key_of(std::string_view head, const SealKey& key) {
  static const Kdf hkdf(EVP_KDF_fetch(nullptr, "HKDF", nullptr), EVP_KDF_free);
  const KdfContext context(hkdf ? EVP_KDF_CTX_new(hkdf.get()) : nullptr, EVP_KDF_CTX_free);
  std::string salt(head.substr(1, SealedSession::kIdBytes));
  std::string info = "stillmap seal 1";
  info += head.substr(1 + SealedSession::kIdBytes, kFreshBytes);
  KeyBytes master{};
  std::copy(key.bytes().begin(), key.bytes().end(), master.begin());
  std::string digest = "SHA256";
  const std::array<OSSL_PARAM, 5> parameters = {
      OSSL_PARAM_construct_utf8_string(OSSL_KDF_PARAM_DIGEST, digest.data(), 0),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_KEY, master.data(), master.size()),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_SALT, salt.data(), salt.size()),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_INFO, info.data(), info.size()),
      OSSL_PARAM_construct_end()};
  KeyBytes derived{};
  const bool done = context && EVP_KDF_derive(context.get(), derived.data(), derived.size(),
                                              parameters.data()) == 1;
  OPENSSL_cleanse(master.data(), master.size());
  if (!done) openssl_failed("HKDF gives no key");
  return derived;
}

/// The count, as 96 bits.
std::string nonce_of(std::string_view head) {
  std::string nonce(kNonceBytes - kCountBytes, '\0');
  nonce += head.substr(1 + SealedSession::kIdBytes + kFreshBytes, kCountBytes);
  return nonce;
}

/// What is authenticated beside what is encrypted. The lengths keep the two texts apart.
std::string authenticated(std::string_view head, const SealOwner& owner) {
  std::string bytes(head);
  put_text(bytes, owner.key_id);
  put_text(bytes, owner.map);
  return bytes;
}

std::string plain_bytes(const SealedSession& session) {
  std::string bytes;
  put_number(bytes, static_cast<std::uint64_t>(session.made_ns));
  bytes += static_cast<char>((session.version_was_named ? kNamed : 0) |
                             (session.is_rolled_out ? kRolledOut : 0) |
                             (session.map.empty() ? 0 : kInSet));
  if (!session.map.empty()) put_text(bytes, session.map);
  put_text(bytes, session.version);
  put_text(bytes, session.vehicle);
  bytes += session.tracker;
  return bytes;
}

/// AES-256-GCM with the key of one seal, one way or the other.
class SealCipher {
 public:
  enum class Way : std::uint8_t { kDecrypt = 0, kEncrypt = 1 };

  /// @param head  says which key and nonce; is authenticated with the owner.
  SealCipher(Way way, std::string_view head, const SealOwner& owner, const SealKey& key) {
    KeyBytes derived = key_of(head, key);
    const std::string nonce = nonce_of(head);
    const bool begun =
        cipher_ && EVP_CipherInit_ex(cipher_.get(), EVP_aes_256_gcm(), nullptr, derived.data(),
                                     to_read(nonce), static_cast<int>(way)) == 1;
    OPENSSL_cleanse(derived.data(), derived.size());
    if (!begun) openssl_failed("AES-256-GCM cannot begin");
    const std::string beside = authenticated(head, owner);
    int size = 0;
    if (EVP_CipherUpdate(cipher_.get(), nullptr, &size, to_read(beside),
                         static_cast<int>(beside.size())) != 1)
      openssl_failed("AES-256-GCM takes no bytes");
  }

  /// All at once.
  std::string convert(std::string_view from) {
    std::string to(from.size(), '\0');
    int size = 0;
    if (EVP_CipherUpdate(cipher_.get(), to_write(to), &size, to_read(from),
                         static_cast<int>(from.size())) != 1)
      openssl_failed("AES-256-GCM takes no bytes");
    return to;
  }
  /// After encrypting.
  std::string tag() {
    std::string tag(kTagBytes, '\0');
    if (!end() ||
        EVP_CIPHER_CTX_ctrl(cipher_.get(), EVP_CTRL_GCM_GET_TAG, kTagBytes, tag.data()) != 1)
      openssl_failed("AES-256-GCM gives no tag");
    return tag;
  }
  /// After decrypting: whether all is as it was encrypted.
  bool fits(std::string tag) {
    if (EVP_CIPHER_CTX_ctrl(cipher_.get(), EVP_CTRL_GCM_SET_TAG, kTagBytes, tag.data()) != 1)
      openssl_failed("AES-256-GCM takes no tag");
    const bool fitting = end();
    ERR_clear_error();
    return fitting;
  }

 private:
  bool end() {
    std::array<unsigned char, kTagBytes> none{};
    int size = 0;
    return EVP_CipherFinal_ex(cipher_.get(), none.data(), &size) == 1;
  }

  Cipher cipher_{EVP_CIPHER_CTX_new(), EVP_CIPHER_CTX_free};
};

}  // namespace

SealKey::~SealKey() { OPENSSL_cleanse(bytes_.data(), bytes_.size()); }

SealKey SealKey::make() {
  SealKey key;
  if (RAND_bytes(key.bytes_.data(), static_cast<int>(kBytes)) != 1)
    openssl_failed("there is no randomness to make a key of");
  return key;
}

std::optional<SealKey> SealKey::from_hex(std::string_view hex) {
  if (!is_digest(hex)) return std::nullopt;  // 32 bytes, too
  const std::string bytes = bytes_of_hex(hex);
  SealKey key;
  std::copy(bytes.begin(), bytes.end(), key.bytes_.begin());
  return key;
}

std::string SealKey::hex() const { return fmt::format("{:02x}", fmt::join(bytes_, "")); }

std::string seal(const SealedSession& session, const SealOwner& owner, const SealKey& key) {
  if (session.id.size() != SealedSession::kIdBytes || !is_digest(session.digest))
    throw std::invalid_argument("seal: an id of 16 bytes and a digest of 64 hex digits expected");
  std::string bytes(1, kFormat);
  bytes += session.id;
  bytes += random_bytes(kFreshBytes);
  put_number(bytes, session.count);
  bytes += bytes_of_hex(session.digest);
  SealCipher cipher(SealCipher::Way::kEncrypt, bytes, owner, key);
  const std::string hidden = cipher.convert(plain_bytes(session));
  std::string text = to_base64(bytes + hidden + cipher.tag());
  if (text.size() > kMaxSealText) throw std::invalid_argument("seal: too long");
  return text;
}

std::optional<SealedSession> open_seal(std::string_view text, const SealOwner& owner,
                                       const SealKey& key) {
  if (text.size() > kMaxSealText) return std::nullopt;
  const std::optional<std::string> bytes = from_base64(text);
  if (!bytes || bytes->size() < kHeadBytes + kTagBytes || bytes->front() != kFormat)
    return std::nullopt;
  const std::string_view all(*bytes);
  const std::string_view head = all.substr(0, kHeadBytes);
  const std::string_view tag = all.substr(all.size() - kTagBytes);
  SealCipher cipher(SealCipher::Way::kDecrypt, head, owner, key);
  const std::string plain =
      cipher.convert(all.substr(kHeadBytes, all.size() - kHeadBytes - kTagBytes));
  if (!cipher.fits(std::string(tag))) return std::nullopt;
  SealedSession session;
  Reader of_head(head.substr(1));
  session.id = of_head.take(SealedSession::kIdBytes);
  (void)of_head.take(kFreshBytes);
  session.count = of_head.number();
  session.digest = hex_of_bytes(of_head.rest());
  Reader from(plain);
  session.made_ns = static_cast<std::int64_t>(from.number());
  const unsigned char flags = from.byte();
  session.version_was_named = (flags & kNamed) != 0;
  session.is_rolled_out = (flags & kRolledOut) != 0;
  if ((flags & kInSet) != 0) session.map = from.text();
  session.version = from.text();
  session.vehicle = from.text();
  session.tracker = from.rest();
  if (from.failed()) return std::nullopt;
  return session;
}

}  // namespace stillmap::server
