#pragma once

#include <libpq-fe.h>

namespace stillmap::server {

/// The functions of PostgreSQL's client library that are used here. The library is loaded when a
/// state in PostgreSQL is opened first: who has none needs no libpq.
struct Libpq {
  decltype(&::PQconnectdbParams) connect;
  decltype(&::PQfinish) finish;
  decltype(&::PQstatus) status;
  decltype(&::PQerrorMessage) error;
  decltype(&::PQsetnonblocking) set_nonblocking;
  decltype(&::PQsendQuery) send_query;
  decltype(&::PQsendQueryParams) send_params;
  decltype(&::PQflush) flush;
  decltype(&::PQisBusy) is_busy;
  decltype(&::PQgetResult) next_result;
  decltype(&::PQresultStatus) result_status;
  decltype(&::PQresultErrorField) error_field;
  decltype(&::PQresultErrorMessage) result_error;
  decltype(&::PQclear) clear;
  decltype(&::PQntuples) rows;
  decltype(&::PQgetvalue) value;
  decltype(&::PQgetlength) length;
  decltype(&::PQgetisnull) is_null;
  decltype(&::PQcmdTuples) changed;
  decltype(&::PQcmdStatus) command;
  decltype(&::PQtransactionStatus) transaction;
  decltype(&::PQsetNoticeReceiver) on_notice;
  decltype(&::PQsocket) socket;
  decltype(&::PQconsumeInput) consume;
  decltype(&::PQnotifies) notification;
  decltype(&::PQfreemem) free;
  decltype(&::PQconninfoParse) parse;
  decltype(&::PQconninfoFree) free_parsed;
};

/// @throws InputError that says which package brings it, when it is not there.
[[nodiscard]] const Libpq& libpq();

}  // namespace stillmap::server
