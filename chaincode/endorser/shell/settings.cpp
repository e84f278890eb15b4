#include "chaincode/endorser/shell/settings.hpp"

namespace ledgerline::endorser {
namespace {

int check_one_in(Config& config, const std::string& table, int otherwise) {
  return static_cast<int>(config.integer(
      {table + "check_one_in",
       "of so many proposals, at random, one is asked of the peer as well: an answer that differs ends the endorser"},
      otherwise, 1, 1'000'000));
}

std::string client_ca(Config& config, const std::string& table) {
  return config.text(
      {table + "tls_client_ca",
       "PEM file of the authorities whose certificates its clients must have to connect; none: they need "
       "none"},
      "");
}

std::string checkpoint(Config& config, const std::string& table) {
  return config.text({table + "checkpoint",
                      "file of what it knows of the chain, written every ten minutes and at the end: the next start "
                      "reads the blocks behind it alone. Anyone who may write it decides what is endorsed: 0600",
                      "none: each start reads all blocks"},
                     "");
}

FirstStateSettings first_state(Config& config, const std::string& table) {
  FirstStateSettings out;
  out.folder = config.text(
      {table + "first_state",
       "folder of a snapshot that a peer of Fabric made (`peer snapshot submitrequest`): a start without a checkpoint "
       "begins behind it. What the contract's keys hold is then [the peer's word]"
       "(fabric.md#an-organisations-own-endorser)",
       "none: such a start reads all blocks"},
      "");
  out.hash = config.text(
      {table + "first_state_hash",
       "the snapshot's `snapshot_hash` as another organisation's peer has it of the same block: a snapshot with "
       "another one is refused",
       "none: the folder is trusted"},
      "");
  return out;
}

}  // namespace

Settings read_settings(Config& config) {
  Settings out;
  out.serve.listen =
      config.text({"serve.listen", "ADDRESS:PORT where it serves; port 0 takes a free one"}, "127.0.0.1:0");
  out.serve.tls_certificate = config.text({"serve.tls_certificate", "PEM file, of its server"});
  out.serve.tls_key = config.text({"serve.tls_key", "PEM file of that certificate's key"});
  out.serve.tls_client_ca = client_ca(config, "serve.");
  out.check_one_in = check_one_in(config, "serve.", out.check_one_in);
  out.first_state = first_state(config, "start.");
  out.checkpoint = checkpoint(config, "output.");
  out.summary = config.text({"output.summary", "JSON file that is written at the end", "none"}, "");
  return out;
}

Settings read_own_endorser_settings(Config& config) {
  Settings out;
  out.msp_dir = config.text(
      {"own_endorser.msp_dir",
       "folder with an identity of OU=peer, with which this process endorses for its organisation by itself, and asks "
       "others only where it cannot: an intruder there has that key ([what it "
       "costs](fabric.md#an-organisations-own-endorser)); "
       "needs config_block and [[orderer]]",
       "none: others endorse"},
      "");
  out.check_one_in = check_one_in(config, "own_endorser.", out.check_one_in);
  out.checkpoint = checkpoint(config, "own_endorser.");
  out.first_state = first_state(config, "own_endorser.");
  out.serve.listen = config.text({"own_endorser.listen",
                                  "ADDRESS:PORT where it serves other programs, too, as `ledgerline endorser` does; "
                                  "with tls_certificate and tls_key",
                                  "none: this process alone"},
                                 "");
  out.serve.tls_certificate = config.text({"own_endorser.tls_certificate", "PEM file, of that server"}, "");
  out.serve.tls_key = config.text({"own_endorser.tls_key", "PEM file of that certificate's key"}, "");
  out.serve.tls_client_ca = client_ca(config, "own_endorser.");
  out.summary = config.text({"own_endorser.summary", "JSON file of what it did, written at the end", "none"}, "");
  return out;
}

}  // namespace ledgerline::endorser
