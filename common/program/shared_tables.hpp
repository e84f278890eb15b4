#pragma once
#include <string>

namespace ledgerline {

/// Help of the tables that several programs' configs have, each read by one reader (common/fabric/config.hpp,
/// common/dds/settings/config.hpp, common/bridge/core/rules.hpp): lines for a program's notes.
inline const std::string ledger_table_help =
    "  [ledger] endpoint, tls_ca, msp_id, msp_dir (or certificate, private_key), blocks, timeouts (fixed|auto);\n"
    "  [[orderer]], [[peer]] endpoint, tls_ca, and as [ledger] server_name, tls_certificate, tls_key; [[msp]] id, ca\n";

inline const std::string channel_tables_help =
    "  [[channel]] name, contract, config_block, endpoint, tls_ca, server_name, tls_certificate, tls_key: a further\n"
    "    channel; [[drone]] channel; [[orderer]], [[endorser]], [[peer]] channels (docs/fabric.md)\n";

inline const std::string dds_table_help =
    "  [dds] domain (ROS_DOMAIN_ID); local_only, interfaces and peers, or cyclonedds; ros_release; for DDS Security\n"
    "    identity_ca, certificate, private_key, governance, permissions\n";

inline const std::string topic_tables_help =
    "  [[topic]] name (\"/a/b\", * stands for any characters), and with defaults\n"
    "    type (any), direction (both|to_ledger|from_ledger), from (first segment of the ids that are taken from\n"
    "    the ledger, must be given; \"*\": anybody's), channel,\n"
    "    keep (all|latest), latched, stream, rate_hz, every, priority (0-9, 5), queue (256), reliable, depth\n"
    "  [[enrolled]] name: enrolled to this identity; topics below /NAME/ have the id NAME/... on the ledger,\n"
    "    all others MSPID/...\n"
    "  [bridge] name, min_gap_ms; [output] status: a file for `ledgerline topics`\n";

}  // namespace ledgerline
