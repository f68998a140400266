#include "signing/ed25519.hpp"

#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <sys/stat.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <span>
#include <stdexcept>
#include <vector>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<unsigned char>;
using OpenKey = std::shared_ptr<EVP_PKEY>;
using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using DigestContext = std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)>;

constexpr std::size_t kKeyBytes = 32, kSignatureBytes = 64;

[[noreturn]] void fail(const char* what) {
  ERR_clear_error();
  throw std::runtime_error(std::string("OpenSSL: ") + what);
}

OpenKey owned(EVP_PKEY* key) { return {key, EVP_PKEY_free}; }

/// Without it OpenSSL would ask at the terminal.
int no_pass_phrase(char*, int, int, void*) { return 0; }

std::string hex_of(std::span<const unsigned char> bytes) {
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

std::optional<Bytes> bytes_of(std::string_view hex, std::size_t count) {
  if (hex.size() != 2 * count) return std::nullopt;
  const auto digit = [](char c) { return c <= '9' ? c - '0' : c - 'a' + 10; };
  Bytes bytes;
  for (std::size_t i = 0; i < hex.size(); i += 2) {
    for (const char c : hex.substr(i, 2))
      if (!((c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'))) return std::nullopt;
    bytes.push_back(static_cast<unsigned char>(16 * digit(hex[i]) + digit(hex[i + 1])));
  }
  return bytes;
}

PublicKey public_key_of(EVP_PKEY* key) {
  std::array<unsigned char, kKeyBytes> bytes{};
  std::size_t size = bytes.size();
  if (EVP_PKEY_get_raw_public_key(key, bytes.data(), &size) != 1 || size != bytes.size())
    fail("no public key");
  return hex_of(bytes);
}

/// Makes a file of what OpenSSL writes. @param mode  before the umask.
template <typename Write>
void write_pem(const fs::path& file, unsigned mode, const Write& write) {
  const Bio bio(BIO_new(BIO_s_mem()), BIO_free);
  if (!bio || write(bio.get()) != 1) fail("the key cannot be written");
  char* text = nullptr;
  const long size = BIO_get_mem_data(bio.get(), &text);
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (descriptor < 0 && errno == EEXIST)
    throw maps::InputError(file.string(), "a file", "none: choose another name, or move it away");
  if (descriptor < 0) throw maps::StorageError(file.string(), std::strerror(errno));
  const bool is_written =
      ::write(descriptor, text, static_cast<std::size_t>(size)) == size && ::fsync(descriptor) == 0;
  const int reason = errno;
  ::close(descriptor);
  if (is_written) return;
  ::unlink(file.c_str());
  throw maps::StorageError(file.string(), std::strerror(reason));
}

Bio text_bio(const std::string& text) {
  return {BIO_new_mem_buf(text.data(), static_cast<int>(text.size())), BIO_free};
}

}  // namespace

SigningKey SigningKey::make() {
  EVP_PKEY* const key = EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519");
  if (key == nullptr) fail("no key can be made");
  return SigningKey(owned(key));
}

SigningKey SigningKey::read(const fs::path& file) {
  const std::string text = maps::read_text(file);
  const Bio bio = text_bio(text);
  const OpenKey key = owned(PEM_read_bio_PrivateKey(bio.get(), nullptr, no_pass_phrase, nullptr));
  ERR_clear_error();
  if (!key || EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519)
    throw maps::InputError(file.string(), key ? "another kind of key" : "no private key in PEM",
                           "an Ed25519 key without a pass phrase: make one with `stillmap keys "
                           "sign make`");
  return SigningKey(key);
}

void SigningKey::write(const fs::path& file) const {
  write_pem(file, S_IRUSR | S_IWUSR, [&](BIO* bio) {
    return PEM_write_bio_PrivateKey(bio, key_.get(), nullptr, nullptr, 0, nullptr, nullptr);
  });
}

void SigningKey::write_public(const fs::path& file) const {
  write_pem(file, S_IRUSR | S_IWUSR | S_IRGRP | S_IROTH,
            [&](BIO* bio) { return PEM_write_bio_PUBKEY(bio, key_.get()); });
}

PublicKey SigningKey::public_key() const { return public_key_of(key_.get()); }

std::string SigningKey::sign(std::string_view text) const {
  const DigestContext context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  std::array<unsigned char, kSignatureBytes> bytes{};
  std::size_t size = bytes.size();
  const auto* const data = reinterpret_cast<const unsigned char*>(text.data());
  if (!context || EVP_DigestSignInit(context.get(), nullptr, nullptr, nullptr, key_.get()) != 1 ||
      EVP_DigestSign(context.get(), bytes.data(), &size, data, text.size()) != 1)
    fail("the key cannot sign");
  return hex_of(bytes);
}

PublicKeys read_public_keys(const fs::path& file) {
  const std::string text = maps::read_text(file);
  const Bio bio = text_bio(text);
  PublicKeys keys;
  while (const OpenKey key =
             owned(PEM_read_bio_PUBKEY(bio.get(), nullptr, no_pass_phrase, nullptr))) {
    if (EVP_PKEY_get_id(key.get()) != EVP_PKEY_ED25519)
      throw maps::InputError(file.string(), "another kind of key",
                             "Ed25519: make one with `stillmap keys sign make`");
    keys.insert(public_key_of(key.get()));
  }
  ERR_clear_error();
  if (keys.empty())
    throw maps::InputError(file.string(), "no public key in PEM",
                           "at least one: the .pub file of `stillmap keys sign make`");
  return keys;
}

bool is_signature(std::string_view signature, std::string_view text, const PublicKey& key) {
  const auto key_bytes = bytes_of(key, kKeyBytes);
  const auto bytes = bytes_of(signature, kSignatureBytes);
  if (!key_bytes || !bytes) return false;
  const OpenKey opened = owned(
      EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, key_bytes->data(), key_bytes->size()));
  const DigestContext context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  const auto* const data = reinterpret_cast<const unsigned char*>(text.data());
  const bool is_good =
      opened && context &&
      EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, opened.get()) == 1 &&
      EVP_DigestVerify(context.get(), bytes->data(), bytes->size(), data, text.size()) == 1;
  ERR_clear_error();
  return is_good;
}

}  // namespace stillmap::server
