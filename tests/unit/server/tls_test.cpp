#include "transport_fixture.hpp"

#include "support/temporary_folder.hpp"

#include <gmock/gmock.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <stillmap/maps/error.hpp>

#include <cstdio>
#include <fstream>

// After what brings in Eigen, see http_exchange.cpp.
#include <httplib.h>

namespace stillmap::server {
namespace tls_test {

using ::testing::HasSubstr;
using ::testing::StartsWith;

/// Writes a self-signed certificate of this serial number with its key.
void write_identity(const std::filesystem::path& folder, long serial) {
  EVP_PKEY* key = EVP_EC_gen("P-256");
  X509* certificate = X509_new();
  ASN1_INTEGER_set(X509_get_serialNumber(certificate), serial);
  X509_gmtime_adj(X509_getm_notBefore(certificate), 0);
  X509_gmtime_adj(X509_getm_notAfter(certificate), 3600);
  X509_set_pubkey(certificate, key);
  X509_NAME* name = X509_get_subject_name(certificate);
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC,
                             reinterpret_cast<const unsigned char*>("localhost"), -1, -1, 0);
  X509_set_issuer_name(certificate, name);
  X509_sign(certificate, key, EVP_sha256());
  std::FILE* file = std::fopen((folder / "cert.pem").c_str(), "w");
  PEM_write_X509(file, certificate);
  std::fclose(file);
  file = std::fopen((folder / "key.pem").c_str(), "w");
  PEM_write_PrivateKey(file, key, nullptr, nullptr, 0, nullptr, nullptr);
  std::fclose(file);
  X509_free(certificate);
  EVP_PKEY_free(key);
}

class TlsTest : public TransportTest {
 protected:
  void SetUp() override {
    write_identity(folder_.path(), 1);
    start(endpoint());
  }
  Endpoint endpoint() const {
    Endpoint endpoint = small_endpoint();
    endpoint.tls = {.certificate_file = (folder_.path() / "cert.pem").string(),
                    .key_file = (folder_.path() / "key.pem").string()};
    return endpoint;
  }
  std::unique_ptr<httplib::SSLClient> client() const {
    auto made = std::make_unique<httplib::SSLClient>("127.0.0.1", port_);
    made->enable_server_certificate_verification(false);
    return made;
  }
  /// The serial number that a new connection sees.
  long serial() const {
    const auto made = client();
    made->Get("/livez");
    SSL_CTX* context = made->ssl_context();
    long number = -1;
    if (SSL* ssl = SSL_new(context)) {
      RawClient raw(port_);
      SSL_set_fd(ssl, raw.socket());
      if (SSL_connect(ssl) == 1) {
        X509* certificate = SSL_get1_peer_certificate(ssl);
        number = ASN1_INTEGER_get(X509_get0_serialNumber(certificate));
        X509_free(certificate);
      }
      SSL_free(ssl);
    }
    return number;
  }

  test::TemporaryFolder folder_;
};

TEST_F(TlsTest, AnswersAndTellsBrowsersToStay) {
  const auto made = client();
  made->set_keep_alive(true);
  for (int i = 0; i < 3; ++i) {
    const auto answer = made->Get("/source");
    ASSERT_TRUE(answer) << httplib::to_string(answer.error());
    EXPECT_EQ(answer->body.size(), ScriptedHandler::kSourceBytes);
    EXPECT_EQ(answer->get_header_value("Strict-Transport-Security"), "max-age=31536000");
  }
  const auto echo = made->Post("/echo", std::string(4000, 'x'), "text/plain");
  ASSERT_TRUE(echo);
  EXPECT_EQ(echo->body.size(), 4000U);
  EXPECT_THAT(metrics_.text(), HasSubstr("tls_certificate_end_timestamp_seconds"));
}

TEST_F(TlsTest, OldProtocolsAreRefused) {
  const auto made = client();
  SSL_CTX_set_max_proto_version(made->ssl_context(), TLS1_1_VERSION);
  EXPECT_FALSE(made->Get("/livez"));
  const auto newer = client();
  SSL_CTX_set_max_proto_version(newer->ssl_context(), TLS1_2_VERSION);
  EXPECT_TRUE(newer->Get("/livez"));
}

TEST_F(TlsTest, LimitsHoldUnderIt) {
  const auto made = client();
  EXPECT_EQ(made->Get("/livez", {{"X", std::string(5000, 'x')}})->status, 431);
  EXPECT_EQ(made->Post("/echo", std::string(5000, 'x'), "text/plain")->status, 413);
}

TEST_F(TlsTest, WhoeverDoesNotShakeHandsIsLetGo) {
  EXPECT_EQ(raw("").size(), 0U);  // closed after the stall time-out, without a word
  raw("GET /livez HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(metrics_.text(), HasSubstr("connections_refused_total{reason=\"tls\"} 2"));
  EXPECT_TRUE(client()->Get("/livez"));
}

TEST_F(TlsTest, CertificateIsReadAgainOrKept) {
  EXPECT_EQ(serial(), 1);
  write_identity(folder_.path(), 2);
  EXPECT_EQ(serial(), 1);
  const std::function<void()> put_in_force = http_->prepare_certificate();
  EXPECT_EQ(serial(), 1);
  put_in_force();
  EXPECT_EQ(serial(), 2);
  std::ofstream(folder_.path() / "cert.pem") << "nothing";
  EXPECT_THROW(static_cast<void>(http_->prepare_certificate()), maps::InputError);
  EXPECT_EQ(serial(), 2);
}

TEST_F(TlsTest, FilesThatDoNotFitAreNamed) {
  const auto message = [&](const TlsOptions& tls) -> std::string {
    try {
      TlsIdentity(tls.certificate_file, tls.key_file);
    } catch (const maps::InputError& error) {
      return error.what();
    }
    return "no error";
  };
  const TlsOptions good = endpoint().tls;
  EXPECT_THAT(message({.certificate_file = "/nowhere/c.pem", .key_file = good.key_file}),
              StartsWith("/nowhere/c.pem: "));
  EXPECT_THAT(message({.certificate_file = good.certificate_file, .key_file = "/nowhere/k.pem"}),
              StartsWith("/nowhere/k.pem: "));
  const test::TemporaryFolder other;
  write_identity(other.path(), 3);
  const std::string other_key = (other.path() / "key.pem").string();
  EXPECT_THAT(message({.certificate_file = good.certificate_file, .key_file = other_key}),
              StartsWith(other_key + ": "));
}

TEST_F(TlsTest, StopsSoonWithOpenConnections) {
  const auto made = client();
  made->set_keep_alive(true);
  ASSERT_TRUE(made->Get("/livez"));
  RawClient silent(port_);
  const auto begin = std::chrono::steady_clock::now();
  stop();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(3));
}

}  // namespace tls_test
}  // namespace stillmap::server
