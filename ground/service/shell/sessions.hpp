#pragma once
#include <boost/asio/ip/tcp.hpp>

#include "ground/service/core/guard.hpp"
#include "ground/service/shell/hub.hpp"

namespace ledgerline::ground::service {

/// Serves one connection until it ends: requests one by one, or, behind an upgrade, the stream. Both outlive it.
void serve_http(boost::asio::ip::tcp::socket socket, Hub& hub, const Guard& guard);

}  // namespace ledgerline::ground::service
