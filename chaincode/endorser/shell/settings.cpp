#include "chaincode/endorser/shell/settings.hpp"

namespace ledgerline::endorser {

Settings read_settings(Config& config) {
  Settings out;
  out.listen = config.text({"serve.listen", "ADDRESS:PORT where it serves; port 0 takes a free one"}, "127.0.0.1:0");
  out.tls_certificate = config.text({"serve.tls_certificate", "PEM file, of its server"});
  out.tls_key = config.text({"serve.tls_key", "PEM file of that certificate's key"});
  out.check_one_in = static_cast<int>(config.integer(
      {"serve.check_one_in",
       "of so many proposals, at random, one is asked of the peer as well: an answer that differs ends the endorser"},
      out.check_one_in, 1, 1'000'000));
  out.summary = config.text({"output.summary", "JSON file that is written at the end", "none"}, "");
  return out;
}

}  // namespace ledgerline::endorser
