// One side of a two-way exchange as the published bridge is built: Fabric's official client, one transaction per message.
// Started by ledgerline bench: node client.cjs a|b SCHEDULE LEDGER (both JSON).
'use strict';
const crypto = require('node:crypto');
const fs = require('node:fs');
const path = require('node:path');
const grpc = require('@grpc/grpc-js');
const { connect, hash, signers } = require('@hyperledger/fabric-gateway');
const { common, gateway, orderer, peer } = require('@hyperledger/fabric-protos');

const [role, scheduleText, ledgerText] = process.argv.slice(2);
const schedule = JSON.parse(scheduleText);
const ledger = JSON.parse(ledgerText);
const ask = role === 'a';
const mostInFlight = 1000; // beyond that a message is not sent, and counted
const streamsOf = (mspId, asset) => Array.from({ length: schedule.streams }, (_, k) => `${mspId}/${asset}${k + 1}`);
const ofA = { mspId: 'Org1MSP', ids: streamsOf('Org1MSP', 'odom'), topic: '/odom' };
const ofB = { mspId: 'Org2MSP', ids: streamsOf('Org2MSP', 'ori_odom'), topic: '/ori_odom' };
const [own, others] = ask ? [ofA, ofB] : [ofB, ofA];

const say = (line) => process.stdout.write(`${JSON.stringify(line)}\n`);
const now = () => process.hrtime.bigint(); // CLOCK_MONOTONIC
// A GatewayError lists what peers said; gRPC's own errors have a text.
const textOf = (error) => (Array.isArray(error.details)
  ? `${error.message} ${error.details.map((detail) => detail.message)}` : error.message);
const counts = { transactions: 0, failed: 0, dropped: 0, inFlight: 0, why: '' };

const only = (dir) => fs.readFileSync(path.join(ledger.mspDir, dir, fs.readdirSync(path.join(ledger.mspDir, dir))[0]));
const sign = signers.newPrivateKeySigner(crypto.createPrivateKey(only('keystore')));
const channelTo = (endpoint, ca) => new grpc.Client(endpoint, grpc.credentials.createSsl(fs.readFileSync(ca)));
const rpc = channelTo(ledger.endpoint, ledger.tlsCa);
const client = connect({
  client: rpc, identity: { mspId: own.mspId, credentials: only('signcerts') }, signer: sign,
  evaluateOptions: () => ({ deadline: Date.now() + 15_000 }),
  endorseOptions: () => ({ deadline: Date.now() + 15_000 }),
  submitOptions: () => ({ deadline: Date.now() + 15_000 }),
  commitStatusOptions: () => ({ deadline: Date.now() + 60_000 }),
});
const network = client.getNetwork('teleop');
const contract = network.getContract('ledgerline');

// An odometry in the published layout: the same text as write_message() makes.
const zeros = `[${Array(36).fill(0)}]`;
function message(n, stamp) {
  return `{"topic":"${own.topic}","msg_type":"nav_msgs/msg/Odometry","msg":{"header":{"seq":${n},"stamp":{"sec":`
    + `${stamp / 1_000_000_000n},"nanosec":${stamp % 1_000_000_000n}},"frame_id":"map"},"child_frame_id":"base_link","pose":`
    + '{"pose":{"position":{"x":0.75,"y":-0.25,"z":1.02},"orientation":{"x":0,"y":0,"z":0.38,"w":0.92}},"covariance":'
    + `${zeros}},"twist":{"twist":{"linear":{"x":0.5,"y":0,"z":0},"angular":{"x":0,"y":0,"z":0.1}},"covariance":${zeros}}}}`;
}

// The gateway's whole way: endorse, submit, wait for the commit.
const throughGateway = (asset) => contract.submitTransaction('set', asset);

// Past the gateway: endorsed by the own peer's Endorser, ordered on one long-lived Broadcast stream. The commit is not
// asked for.
function directly() {
  const broadcast = channelTo(ledger.orderer, ledger.ordererTlsCa).makeBidiStreamRequest(
    '/orderer.AtomicBroadcast/Broadcast', (envelope) => Buffer.from(envelope.serializeBinary()),
    orderer.BroadcastResponse.deserializeBinary);
  const waiting = []; // acknowledgements come in order
  const fail = (error) => waiting.splice(0).forEach(({ reject }) => reject(error));
  broadcast.on('data', (response) => {
    const { resolve, reject } = waiting.shift();
    if (response.getStatus() === common.Status.SUCCESS) resolve();
    else reject(new Error(`orderer: status ${response.getStatus()} ${response.getInfo()}`));
  });
  broadcast.on('error', fail);
  broadcast.on('end', () => fail(new Error('the orderer ended the stream')));
  // A majority endorses: the own peer and another organisation's, side by side.
  const peers = ledger.endorsers.map(({ endpoint, tlsCa }) =>
    new grpc.Client(endpoint, grpc.credentials.createSsl(fs.readFileSync(tlsCa))));
  const propose = (at, signed) => new Promise((resolve, reject) => {
    at.makeUnaryRequest('/protos.Endorser/ProcessProposal', (request) => Buffer.from(request.serializeBinary()),
      peer.ProposalResponse.deserializeBinary, signed, { deadline: Date.now() + 15_000 },
      (error, response) => (error ? reject(error) : resolve(response)));
  });
  return async (asset) => {
    const proposal = contract.newProposal('set', { arguments: [asset] });
    const signed = gateway.ProposedTransaction.deserializeBinary(proposal.getBytes()).getProposal();
    signed.setSignature(await sign(proposal.getDigest()));
    const responses = await Promise.all(peers.map((at) => propose(at, signed)));
    const refused = responses.find((one) => one.getResponse().getStatus() >= 400);
    if (refused) throw new Error(refused.getResponse().getMessage());
    const [response] = responses;

    const asked = peer.Proposal.deserializeBinary(signed.getProposalBytes_asU8());
    const header = common.Header.deserializeBinary(asked.getHeader_asU8());
    const endorsed = new peer.ChaincodeEndorsedAction();
    endorsed.setProposalResponsePayload(response.getPayload_asU8());
    endorsed.setEndorsementsList(responses.map((one) => one.getEndorsement()));
    const payload = new peer.ChaincodeActionPayload();
    payload.setChaincodeProposalPayload(asked.getPayload_asU8()); // there is no transient data to leave out
    payload.setAction(endorsed);
    const action = new peer.TransactionAction();
    action.setHeader(header.getSignatureHeader_asU8());
    action.setPayload(payload.serializeBinary());
    const transaction = new peer.Transaction();
    transaction.setActionsList([action]);
    const whole = new common.Payload();
    whole.setHeader(header);
    whole.setData(transaction.serializeBinary());
    const envelope = new common.Envelope();
    envelope.setPayload(whole.serializeBinary());
    envelope.setSignature(await sign(hash.sha256(envelope.getPayload_asU8())));
    await new Promise((resolve, reject) => {
      waiting.push({ resolve, reject });
      broadcast.write(envelope);
    });
  };
}

const submit = ledger.way === 'direct' ? directly() : throughGateway;
async function send(n, stamp) {
  if (counts.inFlight >= mostInFlight) {
    counts.dropped += 1;
    return;
  }
  counts.inFlight += 1;
  try {
    await submit(JSON.stringify({
      id: own.ids[n % schedule.streams], msgType: 'nav_msgs/msg/Odometry',
      msgData: Buffer.from(message(n, stamp)).toString('base64'),
    }));
    counts.transactions += 1;
  } catch (error) {
    counts.failed += 1;
    counts.why = textOf(error);
  }
  counts.inFlight -= 1;
}

function take(assets, each) {
  for (const asset of assets) {
    if (!others.ids.includes(asset.id)) continue;
    const { header } = JSON.parse(Buffer.from(asset.msgData, 'base64')).msg;
    each(asset.id, header.seq, BigInt(header.stamp.sec) * 1_000_000_000n + BigInt(header.stamp.nanosec));
  }
}

// Driven by the contract's events.
async function events(each) {
  const stream = await network.getChaincodeEvents('ledgerline');
  (async () => {
    for await (const event of stream) {
      if (event.eventName === 'set') take(JSON.parse(Buffer.from(event.payload)).assets ?? [], each);
    }
  })().catch((error) => {
    counts.why = textOf(error);
  });
}

// By asking again and again, and comparing with a cache of what was there the last time.
async function polling(each) {
  const cache = new Map();
  const wanted = others.ids.length === 1 ? others.ids[0] : `${others.mspId}/*`;
  const poll = async () => {
    try {
      const answer = JSON.parse(Buffer.from(await contract.evaluateTransaction('get', wanted)));
      take(answer.assets ?? [answer], (id, n, stamp) => {
        if (cache.get(id) === n) return;
        cache.set(id, n);
        each(id, n, stamp);
      });
    } catch (error) {
      const why = textOf(error);
      if (!why.includes('not found')) counts.why = why; // as before the first message
    }
    setTimeout(poll, ledger.pollMs);
  };
  poll();
}
const inOrder = ledger.way === 'polling'; // what was overwritten before it was read is never answered
const listen = inOrder ? polling : events;

// a's account of its messages, as Account in exchange.hpp keeps it.
const account = { sent: 0, answered: 0, replaced: 0, answers: 0, openMeasured: 0, times: [] };
const open = Array.from({ length: schedule.streams }, () => new Map()); // in order of n
const measured = (n) => n >= schedule.first && n < schedule.first + schedule.count;
function closeMessage(n, at, end) {
  if (!measured(n)) return;
  account.openMeasured -= 1;
  account.times.push(Number((end - at) / 1000n));
}
function answered(n, stamp) {
  const end = now();
  const mine = open[n % schedule.streams];
  if (mine.get(n) !== stamp) return;
  account.answers += 1;
  if (inOrder) {
    for (const [older, at] of mine) {
      if (older >= n) break;
      closeMessage(older, at, end);
      if (measured(older)) account.replaced += 1;
      mine.delete(older);
    }
  }
  closeMessage(n, stamp, end);
  if (measured(n)) account.answered += 1;
  mine.delete(n);
}

const dueMs = (n) => 1000 * (Math.min(n, schedule.fast_count) / schedule.fast_per_s + Math.max(0, n - schedule.fast_count) / schedule.per_s);
function end() {
  const at = now();
  for (const mine of open) for (const [n, stamp] of mine) closeMessage(n, stamp, at);
  for (let i = 0; i < account.times.length; i += 1000) say({ latencies_us: account.times.slice(i, i + 1000) });
  const { sent, answered: ofThem, replaced } = account;
  const { transactions, failed, dropped, why } = counts;
  const result = { sent, answered: ofThem, replaced, transactions, failed, dropped, why };
  process.stdout.write(`${JSON.stringify({ result })}\n`, () => process.exit(0));
}

function askAll() {
  const start = now();
  const lastMs = dueMs(schedule.first + schedule.count) + 1000 * schedule.drain_s;
  let n = 0;
  let answersBefore = 0;
  let nextProgressMs = 0;
  const elapsedMs = () => Number(now() - start) / 1e6;
  const turn = () => {
    const ms = elapsedMs();
    if ((n > schedule.first + schedule.count && account.openMeasured === 0) || ms >= lastMs) {
      end();
      return;
    }
    for (; dueMs(n) <= ms; n += 1) {
      if (n === schedule.first) {
        answersBefore = account.answers;
        say({ measuring: true });
      }
      if (n === schedule.first + schedule.count) say({ measured: true, answers: account.answers - answersBefore });
      const stamp = now();
      open[n % schedule.streams].set(n, stamp);
      if (measured(n)) {
        account.sent += 1;
        account.openMeasured += 1;
      }
      send(n, stamp);
    }
    if (ms >= nextProgressMs) {
      nextProgressMs = ms + 1000;
      say({ progress: { sent: account.sent, answered: account.answered } });
    }
    setTimeout(turn, dueMs(n) - elapsedMs());
  };
  turn();
}

process.on('SIGTERM', end);
(async () => {
  await listen((id, n, stamp) => (ask ? answered(n, stamp) : send(n, stamp)));
  say({ ready: true, pid: process.pid });
  if (ask) askAll();
})().catch((error) => {
  process.stderr.write(`${error.stack}\n`);
  process.exit(1);
});
