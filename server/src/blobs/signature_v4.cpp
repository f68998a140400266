#include "blobs/signature_v4.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include <stillmap/maps/map_package.hpp>

namespace stillmap::server {
namespace {

constexpr std::string_view kAlgorithm = "AWS4-HMAC-SHA256";

/// Bytes, not hex.
std::string hmac_sha256(std::string_view key, std::string_view text) {
  std::string result(EVP_MAX_MD_SIZE, '\0');
  unsigned size = 0;
  if (::HMAC(::EVP_sha256(), key.data(), static_cast<int>(key.size()),
             reinterpret_cast<const unsigned char*>(text.data()), text.size(),
             reinterpret_cast<unsigned char*>(result.data()), &size) == nullptr)
    throw std::runtime_error("OpenSSL cannot make an HMAC");
  result.resize(size);
  return result;
}

std::string hex_of(std::string_view bytes) {
  std::string text;
  for (const char byte : bytes) text += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  return text;
}

/// Without spaces at both ends; runs of spaces become one.
std::string trimmed(std::string_view value) {
  std::string result;
  for (const char c : value) {
    const bool is_space = c == ' ' || c == '\t';
    if (is_space && (result.empty() || result.back() == ' ')) continue;
    result += is_space ? ' ' : c;
  }
  if (result.ends_with(' ')) result.pop_back();
  return result;
}

const std::string& header_of(const RequestToSign& request, const char* name) {
  const auto found = request.headers.find(name);
  if (found == request.headers.end())
    throw std::invalid_argument(std::string("a request to sign without the header ") + name);
  return found->second;
}

}  // namespace

std::string percent_encoded(std::string_view text, bool is_path) {
  constexpr std::string_view kKept =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~";
  std::string result;
  for (const char c : text) {
    if (kKept.find(c) != kKept.npos || (is_path && c == '/'))
      result += c;
    else
      result += fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return result;
}

std::string canonical_query(const std::map<std::string, std::string>& query) {
  std::vector<std::pair<std::string, std::string>> encoded;
  for (const auto& [name, value] : query)
    encoded.emplace_back(percent_encoded(name), percent_encoded(value));
  std::ranges::sort(encoded);
  std::string text;
  for (const auto& [name, value] : encoded)
    text += fmt::format("{}{}={}", text.empty() ? "" : "&", name, value);
  return text;
}

std::string authorization_v4(const RequestToSign& request, const SigningScope& scope,
                             const S3Credentials& credentials) {
  (void)header_of(request, "host");
  const std::string& time = header_of(request, "x-amz-date");
  std::string headers;
  std::string names;
  for (const auto& [name, value] : request.headers) {
    headers += name + ":" + trimmed(value) + "\n";
    names += (names.empty() ? "" : ";") + name;
  }
  const std::string canonical =
      fmt::format("{}\n{}\n{}\n{}\n{}\n{}", request.method, request.path,
                  canonical_query(request.query), headers, names, request.body_sha256);
  const std::string date = time.substr(0, 8);
  const std::string place = fmt::format("{}/{}/{}/aws4_request", date, scope.region, scope.service);
  const std::string text =
      fmt::format("{}\n{}\n{}\n{}", kAlgorithm, time, place, maps::sha256_of(canonical));
  std::string key = "AWS4" + credentials.secret_access_key;
  for (const std::string_view part :
       {std::string_view(date), std::string_view(scope.region), std::string_view(scope.service),
        std::string_view("aws4_request")})
    key = hmac_sha256(key, part);
  return fmt::format("{} Credential={}/{}, SignedHeaders={}, Signature={}", kAlgorithm,
                     credentials.access_key_id, place, names, hex_of(hmac_sha256(key, text)));
}

}  // namespace stillmap::server
