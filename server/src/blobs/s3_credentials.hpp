#pragma once

#include "blobs/signature_v4.hpp"

#include <filesystem>
#include <mutex>
#include <string>

namespace stillmap::server {

/// Where the credentials of S3 come from: a file, or the environment where there is none. Messages
/// name the file and the line, never a value. Safe from several threads.
class S3CredentialsSource {
 public:
  /// @param file  of AWS's own format: `aws_access_key_id`, `aws_secret_access_key` and perhaps
  /// `aws_session_token` below `[default]`. Its owner alone may read it. Empty:
  /// `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY` and perhaps `AWS_SESSION_TOKEN` of the
  /// environment.
  explicit S3CredentialsSource(std::filesystem::path file = {});

  /// Those of now: the file is read again when it was changed or replaced.
  /// @throws maps::InputError when there are none; StorageError when the file cannot be read.
  [[nodiscard]] S3Credentials current();

 private:
  std::filesystem::path file_;
  std::mutex mutex_;
  S3Credentials credentials_;
  /// Tells one state of the file from another.
  std::string read_as_;
};

}  // namespace stillmap::server
