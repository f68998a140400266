#pragma once

#include <cstddef>
#include <memory>
#include <string>

// OpenSSL's own names, so that its headers stay in tls.cpp.
struct ssl_st;
struct ssl_ctx_st;

namespace stillmap::server {

/// What one try to move bytes gave.
struct Moved {
  /// > 0 moved; 0 the peer has ended; -1 nothing.
  long bytes = -1;
  /// What to wait for before the next try (POLLIN or POLLOUT); 0 when there is no use.
  short wait_for = 0;
};

/// One TLS connection over a socket that does not block. One thread at a time.
class TlsSession {
 public:
  TlsSession(ssl_ctx_st* context, int socket);
  ~TlsSession();
  TlsSession(const TlsSession&) = delete;
  TlsSession& operator=(const TlsSession&) = delete;

  /// @return 1 byte "moved" once it is done.
  [[nodiscard]] Moved handshake();
  [[nodiscard]] Moved receive(char* to, std::size_t size);
  [[nodiscard]] Moved send(const char* from, std::size_t size);
  /// Tells the peer that no more comes; does not wait.
  void end();

 private:
  [[nodiscard]] Moved result(int returned);

  ssl_st* ssl_;
};

/// A certificate with its key, ready to serve. Immutable: a new certificate is a new object, and
/// connections keep the one that they began with.
class TlsIdentity {
 public:
  /// TLS 1.2 and 1.3, only suites with forward secrecy and authenticated encryption, in our order.
  /// @param certificate_file  PEM, the server's own first, then what leads to a root.
  /// @param key_file  PEM, without a pass phrase.
  /// @throws maps::InputError that names the file.
  TlsIdentity(const std::string& certificate_file, const std::string& key_file);
  ~TlsIdentity();
  TlsIdentity(const TlsIdentity&) = delete;
  TlsIdentity& operator=(const TlsIdentity&) = delete;

  [[nodiscard]] std::unique_ptr<TlsSession> session(int socket) const;
  /// When the certificate ends [s since 1970, UTC].
  [[nodiscard]] double end_unix_s() const { return end_unix_s_; }

 private:
  ssl_ctx_st* context_;
  double end_unix_s_ = 0.0;
};

}  // namespace stillmap::server
