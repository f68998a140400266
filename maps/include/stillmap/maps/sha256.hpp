#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>

namespace stillmap::maps {

/// SHA-256 of bytes that come in pieces (FIPS 180-4). @throws std::runtime_error if OpenSSL fails.
class Sha256 {
 public:
  using Digest = std::array<unsigned char, 32>;

  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();

  void add(const void* bytes, std::size_t size);
  /// Ends it: only `restart` may follow.
  Digest bytes();
  /// The same as lower-case hex.
  std::string hex();
  /// For other bytes; much cheaper than a new one.
  void restart();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

}  // namespace stillmap::maps
