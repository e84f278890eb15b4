#pragma once
#include "chaincode/endorser/shell/settings.hpp"
#include "common/base/result.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::endorser {

/// Where `settings` name an identity: an endorser of the organisation of `ledger` in this process, which all clients
/// that are made with `ledger` afterwards ask first, and which the first of their block streams feeds. It goes with the
/// last of them, and writes its summary then. A bad identity is an error here; later it only logs, and clients ask
/// others.
Status endorse_within(const WithinSettings& settings, fabric::ClientConfig& ledger);

/// An error where a program on several channels is to have one: it follows one channel.
Status check_channels(const WithinSettings& settings, const fabric::Channels& channels);

}  // namespace ledgerline::endorser
