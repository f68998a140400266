#pragma once

#include <map>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Who signs. Never part of a log line or of an error message.
struct S3Credentials {
  std::string access_key_id{};
  std::string secret_access_key{};
  /// Of temporary credentials; empty: none is sent.
  std::string session_token{};
};

/// What of a request is signed.
struct RequestToSign {
  std::string method;
  /// As it is sent: `percent_encoded`, beginning with a slash.
  std::string path;
  /// Names and values as they are, not encoded.
  std::map<std::string, std::string> query{};
  /// Names in lower case, `host` and `x-amz-date` among them; all of them are signed.
  std::map<std::string, std::string> headers{};
  /// Of the body, lower-case hex.
  std::string body_sha256{};
};

/// What a signature is good for, beside the request.
struct SigningScope {
  std::string region, service = "s3";
};

/// All but letters, digits, `-`, `.`, `_`, `~` and, for a path, `/` as %XX.
[[nodiscard]] std::string percent_encoded(std::string_view text, bool is_path = false);

/// The query as it is signed and has to be sent: encoded, sorted by its encoded names.
[[nodiscard]] std::string canonical_query(const std::map<std::string, std::string>& query);

/// The value of the header `Authorization` by AWS Signature Version 4
/// (https://docs.aws.amazon.com/AmazonS3/latest/API/sig-v4-header-based-auth.html).
/// @throws std::invalid_argument without `host` or `x-amz-date`; std::runtime_error if OpenSSL
/// fails.
[[nodiscard]] std::string authorization_v4(const RequestToSign& request, const SigningScope& scope,
                                           const S3Credentials& credentials);

}  // namespace stillmap::server
