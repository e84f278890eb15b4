#pragma once
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <optional>

#include "common/web/wire.hpp"
#include "ground/service/core/guard.hpp"
#include "ground/service/shell/answers.hpp"
#include "ground/service/shell/hub.hpp"

namespace ledgerline::ground::service {

/// Serves one connection until it ends: with TLS its handshake, requests one by one, or, behind an upgrade, the stream.
/// Hub, answers and guard outlive it.
void serve_http(web::Wire wire, Hub& hub, Answers& answers, const Guard& guard);

/// What a connection holds while its stream lasts.
struct StreamPlaces {
  Connections::Place counted;
  Connections::KeptPlace kept;
};

/// Serves the stream behind that request for it, until it ends. `session`: of the operator who opened it. Hub outlives
/// it.
void serve_stream(web::Wire wire, Hub& hub, StreamPlaces places, std::optional<SignIns::Session> session,
                  const boost::beast::http::request<boost::beast::http::string_body>& request);

}  // namespace ledgerline::ground::service
