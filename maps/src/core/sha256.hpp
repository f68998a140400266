#pragma once

#include <openssl/evp.h>

#include <array>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

namespace stillmap::maps {

/// SHA-256 of bytes that come in pieces.
class Sha256 {
 public:
  using Digest = std::array<unsigned char, 32>;

  Sha256() {
    if (!context_ || EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) != 1) {
      throw std::runtime_error("SHA-256 is not available");
    }
  }
  void add(const void* bytes, std::size_t size) {
    if (EVP_DigestUpdate(context_.get(), bytes, size) != 1) {
      throw std::runtime_error("SHA-256 failed");
    }
  }
  /// Ends it: only `restart` may follow.
  Digest bytes() {
    Digest digest{};
    if (EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr) != 1) {
      throw std::runtime_error("SHA-256 failed");
    }
    return digest;
  }
  /// The same as lower-case hex.
  std::string hex() {
    constexpr std::string_view kDigits = "0123456789abcdef";
    std::string text;
    for (const unsigned char byte : bytes()) {
      text += kDigits[byte >> 4U];
      text += kDigits[byte & 15U];
    }
    return text;
  }
  /// For other bytes; much cheaper than a new one.
  void restart() {
    if (EVP_DigestInit_ex(context_.get(), nullptr, nullptr) != 1) {
      throw std::runtime_error("SHA-256 failed");
    }
  }

 private:
  struct Free {
    void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
  };
  std::unique_ptr<EVP_MD_CTX, Free> context_{EVP_MD_CTX_new()};
};

}  // namespace stillmap::maps
