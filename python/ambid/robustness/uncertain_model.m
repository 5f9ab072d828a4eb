% The uncertain model in FILE.mat, written by ambid: x' = A x + B [w; u], [z; y] = C x + D [w; u], w = Delta z.
%
% Entry k of the diagonal Delta is delta_scale(k) * parameter ^ delta_power(k), SI units. The loop is closed by
% u = -K y + i_e. In plain MATLAB or Octave this makes
%   nominal_plant   A, B, C, D from u to y at the nominal values
%   nominal_poles   of the closed loop: in 1/s, or of one sample of a digital K
% and with the Robust Control Toolbox
%   plant           uss from u to y
%   K               ss
%   closed_loop     uss from i_e to y, of an analog K
m = load('FILE.mat');
n_w = numel(m.delta_parameter);
n_x = size(m.A, 1);
n_u = size(m.B, 2) - n_w;

delta = diag(m.delta_scale .* m.nominal(m.delta_parameter) .^ m.delta_power);
gain = (eye(n_w) - delta * m.D(1:n_w, 1:n_w)) \ delta;
nominal_plant.A = m.A + m.B(:, 1:n_w) * gain * m.C(1:n_w, :);
nominal_plant.B = m.B(:, n_w+1:end) + m.B(:, 1:n_w) * gain * m.D(1:n_w, n_w+1:end);
nominal_plant.C = m.C(n_w+1:end, :) + m.D(n_w+1:end, 1:n_w) * gain * m.C(1:n_w, :);
nominal_plant.D = m.D(n_w+1:end, n_w+1:end) + m.D(n_w+1:end, 1:n_w) * gain * m.D(1:n_w, n_w+1:end);

P = nominal_plant;
n_k = size(m.K_A, 1);
if m.K_dt == 0
    nominal_poles = eig([P.A - P.B * m.K_D * P.C, -P.B * m.K_C; m.K_B * P.C, m.K_A]);
else
    % commands are held over a sample and arrive late: `old` acts for the fraction of a sample, then `new`
    whole = floor(m.K_delay);
    part = m.K_delay - whole;
    held = @(t) expm([P.A, P.B; zeros(n_u, n_x + n_u)] * t);
    first = held(part * m.K_dt);
    rest = held((1 - part) * m.K_dt);
    old = rest(1:n_x, 1:n_x) * first(1:n_x, n_x+1:end);
    new = rest(1:n_x, n_x+1:end);
    under_way = whole + 1;
    step = zeros(n_x + n_k + n_u * under_way);
    x = 1:n_x;
    k = n_x + (1:n_k);
    command = @(age) n_x + n_k + n_u * (age - 1) + (1:n_u);
    law = zeros(n_u, size(step, 1));
    law(:, x) = -m.K_D * P.C;
    law(:, k) = -m.K_C;
    step(x, x) = rest(1:n_x, 1:n_x) * first(1:n_x, 1:n_x);
    step(x, command(under_way)) = old;
    if whole == 0
        step(x, :) = step(x, :) + new * law;
    else
        step(x, command(whole)) = step(x, command(whole)) + new;
    end
    step(k, x) = m.K_B * P.C;
    step(k, k) = m.K_A;
    step(command(1), :) = law;
    for age = 2:under_way
        step(command(age), command(age - 1)) = eye(n_u);
    end
    nominal_poles = eig(step);
end

if exist('ureal', 'file')
    number = cell(1, numel(m.nominal));
    for i = 1:numel(m.nominal)
        if isnan(m.lower95(i))
            number{i} = m.nominal(i);
        else
            number{i} = ureal(m.parameters{i}, m.nominal(i), 'Range', [m.lower95(i), m.upper95(i)]);
        end
    end
    entry = cell(1, n_w);
    for i = 1:n_w
        if m.delta_power(i) < 0
            entry{i} = m.delta_scale(i) / number{m.delta_parameter(i)};
        else
            entry{i} = m.delta_scale(i) * number{m.delta_parameter(i)};
        end
    end
    plant = lft(blkdiag(entry{:}), ss(m.A, m.B, m.C, m.D));
    plant.InputName = m.inputs;
    plant.OutputName = m.outputs;
    K = ss(m.K_A, m.K_B, m.K_C, m.K_D, m.K_dt);
    if m.K_dt == 0
        closed_loop = feedback(plant, K);
    end
end
