#include "http/tls.hpp"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <poll.h>

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <climits>
#include <ctime>
#include <string_view>

namespace stillmap::server {
namespace {

std::string first_reason() {
  std::array<char, 256> text{};
  const unsigned long code = ERR_peek_error();
  ERR_error_string_n(code, text.data(), text.size());
  ERR_clear_error();
  return code == 0 ? "nothing usable" : text.data();
}

/// Without it OpenSSL would ask at the terminal, where nobody sits.
int no_pass_phrase(char*, int, int, void*) { return 0; }

/// Clients that offer HTTP/2 as well learn that it is HTTP/1.1 here.
int choose_protocol(SSL*, const unsigned char** chosen, unsigned char* chosen_size,
                    const unsigned char* offered, unsigned int offered_size, void*) {
  static constexpr std::array<unsigned char, 9> kOurs = {8, 'h', 't', 't', 'p', '/', '1', '.', '1'};
  unsigned char* found = nullptr;
  const int result =
      SSL_select_next_proto(&found, chosen_size, kOurs.data(), kOurs.size(), offered, offered_size);
  *chosen = found;
  return result == OPENSSL_NPN_NEGOTIATED ? SSL_TLSEXT_ERR_OK : SSL_TLSEXT_ERR_NOACK;
}

void configure(SSL_CTX* context) {
  SSL_CTX_set_min_proto_version(context, TLS1_2_VERSION);
  SSL_CTX_set_options(context, SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_NO_RENEGOTIATION |
                                   SSL_OP_NO_COMPRESSION | SSL_OP_IGNORE_UNEXPECTED_EOF);
  SSL_CTX_set_cipher_list(context, "ECDHE+AESGCM:ECDHE+CHACHA20");
  SSL_CTX_set_mode(context, SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER |
                                SSL_MODE_RELEASE_BUFFERS);
  SSL_CTX_set_default_passwd_cb(context, no_pass_phrase);
  SSL_CTX_set_alpn_select_cb(context, choose_protocol, nullptr);
  static constexpr std::string_view kName = "stillmap";
  SSL_CTX_set_session_id_context(context, reinterpret_cast<const unsigned char*>(kName.data()),
                                 kName.size());
}

double unix_seconds(const ASN1_TIME* time) {
  std::tm parts{};
  if (time == nullptr || ASN1_TIME_to_tm(time, &parts) != 1) return 0.0;
  return static_cast<double>(::timegm(&parts));
}

/// @throws maps::InputError.
void load(SSL_CTX* context, const std::string& certificate_file, const std::string& key_file) {
  ERR_clear_error();
  if (SSL_CTX_use_certificate_chain_file(context, certificate_file.c_str()) != 1) {
    throw maps::InputError(certificate_file, first_reason(),
                           "a certificate chain in PEM: check tls.certificate_file");
  }
  if (SSL_CTX_use_PrivateKey_file(context, key_file.c_str(), SSL_FILETYPE_PEM) != 1 ||
      SSL_CTX_check_private_key(context) != 1) {
    throw maps::InputError(
        key_file, first_reason(),
        "the private key of " + certificate_file + " in PEM, no pass phrase: check tls.key_file");
  }
}

}  // namespace

TlsSession::TlsSession(ssl_ctx_st* context, int socket) : ssl_(SSL_new(context)) {
  if (ssl_ != nullptr) SSL_set_fd(ssl_, socket);
}

TlsSession::~TlsSession() { SSL_free(ssl_); }

Moved TlsSession::result(int returned) {
  if (returned > 0) return {.bytes = returned};
  switch (SSL_get_error(ssl_, returned)) {
    case SSL_ERROR_WANT_READ:
      return {.bytes = -1, .wait_for = POLLIN};
    case SSL_ERROR_WANT_WRITE:
      return {.bytes = -1, .wait_for = POLLOUT};
    case SSL_ERROR_ZERO_RETURN:
      return {.bytes = 0};
    default:
      return {};
  }
}

Moved TlsSession::handshake() {
  if (ssl_ == nullptr) return {};
  ERR_clear_error();
  return result(SSL_accept(ssl_));
}

Moved TlsSession::receive(char* to, std::size_t size) {
  ERR_clear_error();
  return result(SSL_read(ssl_, to, static_cast<int>(std::min<std::size_t>(size, INT_MAX))));
}

Moved TlsSession::send(const char* from, std::size_t size) {
  ERR_clear_error();
  return result(SSL_write(ssl_, from, static_cast<int>(std::min<std::size_t>(size, INT_MAX))));
}

void TlsSession::end() {
  ERR_clear_error();
  // After a failed handshake there is nobody to tell.
  if (SSL_is_init_finished(ssl_) == 1) SSL_shutdown(ssl_);
}

TlsIdentity::TlsIdentity(const std::string& certificate_file, const std::string& key_file)
    : context_(SSL_CTX_new(TLS_server_method())) {
  if (context_ == nullptr) throw maps::InputError("OpenSSL", first_reason(), "a context");
  try {
    configure(context_);
    load(context_, certificate_file, key_file);
  } catch (...) {
    SSL_CTX_free(context_);
    throw;
  }
  end_unix_s_ = unix_seconds(X509_get0_notAfter(SSL_CTX_get0_certificate(context_)));
}

TlsIdentity::~TlsIdentity() { SSL_CTX_free(context_); }

std::unique_ptr<TlsSession> TlsIdentity::session(int socket) const {
  return std::make_unique<TlsSession>(context_, socket);
}

}  // namespace stillmap::server
