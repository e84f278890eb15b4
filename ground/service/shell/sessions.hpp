#pragma once
#include "common/web/wire.hpp"
#include "ground/service/core/guard.hpp"
#include "ground/service/shell/answers.hpp"
#include "ground/service/shell/hub.hpp"

namespace ledgerline::ground::service {

/// Serves one connection until it ends: with TLS its handshake, requests one by one, or, behind an upgrade, the stream.
/// Hub, answers and guard outlive it.
void serve_http(web::Wire wire, Hub& hub, Answers& answers, const Guard& guard);

}  // namespace ledgerline::ground::service
