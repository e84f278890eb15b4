#pragma once
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/clock.hpp"

/// The tables of a program's config that say where the ledger is and whom to trust; used by agent and ground.
namespace ledgerline::fabric {

/// Reads [ledger]: endpoint, tls_ca, msp_id, and msp_dir or certificate and private_key (must be there); channel,
/// contract, signer, server_name, max_in_flight, deadline_ms (have defaults, the last one by the caller); loads the
/// identity. Wrong keys are reported by config.finish() as always, so call that first when this fails: it has the
/// lines.
Result<ClientConfig> ledger_config(Config& config, std::chrono::milliseconds deadline = std::chrono::seconds(5));

/// Of a file for this alone, or of agent's or ground's whole one, whose other tables are skipped. What Config::finish()
/// finds is an error, too.
Result<ClientConfig> load_ledger_config(const std::string& file);

/// For the log of a program that acts on blocks, where config_block is empty.
inline constexpr const char* blocks_not_validated =
    "config_block is not set: the peer's blocks are accepted without a check of who signed them";

/// Reads [[msp]] (id, ca) and ledger.verifier: the organisations whose signatures are trusted, at least one.
Result<std::unique_ptr<crypto::MspRegistry>> msp_registry(Config& config);

/// The organisations of the [[msp]] tables of a file for load_ledger_config(); empty where it has no such table.
Result<std::vector<crypto::MspRoot>> load_msps(const std::string& file);

/// An error, which says whose authority issued it: nobody of this organisation has the certificate, by the authorities
/// in `msps`, in config_block, and of our own organisation in msp_dir. Done where no authority of it is known.
Status check_certificate_of(const std::string& msp_id, const std::string& certificate_pem, const ClientConfig& config,
                            const std::vector<crypto::MspRoot>& msps);

/// Adds to the config's deadline, and returns, what `timeouts` of [ledger] adds to limits of time: 0 where it is fixed.
/// Of config_block where there is one, so that no peer can lengthen them, else of the peer, which must answer then.
/// Logs what it costs; an error names the channel.
Result<TimeNs> apply_timeouts(ClientConfig& config);

}  // namespace ledgerline::fabric
