#pragma once

#include <span>
#include <string_view>

namespace stillmap::server {

/// Everything that can go wrong with a request. The texts in the table are stable: clients branch
/// on them.
enum class ErrorCode {
  kInvalidRequest,
  kUnknownParameter,
  kUnknownMethod,
  kInvalidScan,
  kUnknownRoute,
  kUnknownMap,
  kUnknownVersion,
  kUnknownTile,
  kMethodNotAllowed,
  kVersionExists,
  kVersionActive,
  kNoPrevious,
  kLengthRequired,
  kRevisionChanged,
  kPayloadTooLarge,
  kUnsupportedMediaType,
  kRangeNotSatisfiable,
  kInvalidPrior,
  kInvalidTransform,
  kInvalidPoints,
  kInvalidBoxes,
  kTooFewPoints,
  kHeaderTooLarge,
  kInternalError,
  kStorageError,
  kBusy,
  kMapLoading,
  kMapUnusable,
  kDeadlineExceeded,
};

struct ErrorInfo {
  ErrorCode code;
  /// What a program looks at.
  std::string_view text;
  /// What a person reads.
  std::string_view title;
  int http_status;
};

[[nodiscard]] const ErrorInfo& info_of(ErrorCode code);
/// The whole table, in the order of the enumeration.
[[nodiscard]] std::span<const ErrorInfo> all_errors();

}  // namespace stillmap::server
